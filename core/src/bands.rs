//! Where a frame's bands come from: a frame that is prepared already, or rows that are read when they are needed.

use crate::correct::{BandInput, BandSource, Ground};
use crate::differences::{Readings, Search};
use crate::frame_stats::FrameStats;
use crate::prepare::{Prepared, baseline};
use sspc_image::{Frame, FrameRows, Image};
use std::borrow::Cow;
use std::convert::Infallible;
use std::ops::Range;
use std::sync::Arc;

/// What is said of a frame without differences, whose model was fitted with some.
pub const WITHOUT_DIFFERENCES: &str = "the model was fitted with differences of y, and this frame has no dx and dy: \
its colours alone judge the correction";

/// A frame whose rows are brought into the method's units band by band.
pub struct FrameBands<'a, R> {
    rows: &'a R,
    stats: FrameStats,
    skip_still_blocks: bool,
    differences: Option<Readings>,
}

/// Rows of a band whose differences are looked over.
const LOOKED_AT: usize = 64;

impl<'a, R: FrameRows> FrameBands<'a, R> {
    /// Bands of a frame that was looked over.
    pub fn new(rows: &'a R, stats: FrameStats, skip_still_blocks: bool) -> Self {
        Self { rows, stats, skip_still_blocks, differences: None }
    }

    /// The same, judged by differences of y too, which weigh `strength` times what their noise deserves: all rows are looked
    /// over to find out what dx and dy hold. And what a person should know; without differences nothing changes.
    ///
    /// # Errors
    /// What reading can raise.
    pub fn with_differences(self, strength: f32) -> Result<(Self, Vec<String>), R::Error> {
        let (height, mut search) = (self.rows.height(), Search::default());
        for top in (0..height).step_by(LOOKED_AT) {
            let end = (top + LOOKED_AT).min(height);
            let frame = self.rows.rows(top..(end + 1).min(height))?;
            let Some(read) = &frame.differences else { return Ok((self, vec![WITHOUT_DIFFERENCES.to_string()])) };
            search.look(read, &Prepared::by_stats(&frame, &self.stats), 0..end - top);
        }
        let (differences, said) = search.finish(strength);
        Ok((Self { differences, ..self }, said))
    }
}

impl<R: FrameRows> BandSource for FrameBands<'_, R> {
    type Error = R::Error;

    fn height(&self) -> usize {
        self.rows.height()
    }

    fn width(&self) -> usize {
        self.rows.width()
    }

    fn stats(&self) -> &FrameStats {
        &self.stats
    }

    fn has_composite(&self) -> bool {
        self.rows.has_composite()
    }

    fn has_differences(&self) -> bool {
        self.differences.is_some()
    }

    fn band(&mut self, rows: Range<usize>, around: usize) -> Result<BandInput<'_>, R::Error> {
        let first = rows.start.saturating_sub(around);
        let last = (rows.end + around).min(self.rows.height());
        let inner = rows.start - first..rows.end - first;
        let frame = self.rows.rows(first..last)?;
        let mut prepared = Prepared::by_stats(&frame, &self.stats);
        if !self.skip_still_blocks {
            prepared = prepared.without_skips(&self.stats);
        }
        if let Some((readings, read)) = self.differences.zip(frame.differences.as_ref()) {
            prepared.differences = Some(Arc::new(readings.of(read, &prepared)));
        }
        let ground = match inner.len() == frame.height() {
            true => Ground::of(&frame, &self.stats),
            false => Ground::of(&frame.colours(inner.start, inner.len()), &self.stats),
        };
        Ok(BandInput { prepared: Cow::Owned(prepared), inner, ground })
    }

    fn ground(&mut self, rows: Range<usize>) -> Result<Ground<'_>, R::Error> {
        Ok(Ground::of(&*self.rows.rows(rows)?, &self.stats))
    }
}

/// A whole frame that is prepared already; its features go when they are not needed any more.
pub struct PreparedFrame<'a> {
    prepared: Option<Prepared>,
    stays: bool,
    stats: FrameStats,
    ground: Ground<'a>,
}

impl<'a> PreparedFrame<'a> {
    /// The frame, and the ground of its picture.
    pub fn new(prepared: Prepared, stats: FrameStats, denoised: &'a Image, fill: &'a [(usize, [f32; 3])]) -> Self {
        let ground = Ground { denoised: Cow::Borrowed(denoised), fill: Cow::Borrowed(fill) };
        Self { prepared: Some(prepared), stays: false, stats, ground }
    }

    /// A frame that is given away as its features are made.
    pub fn of_owned(frame: Frame, stats: FrameStats, skip_still_blocks: bool) -> PreparedFrame<'static> {
        let fill = Ground::fill_of(&baseline(&frame), &frame, &stats);
        let (prepared, denoised) = Prepared::of_owned(frame, &stats);
        let ground = Ground { denoised: Cow::Owned(denoised), fill: Cow::Owned(fill) };
        let prepared = if skip_still_blocks { prepared } else { prepared.without_skips(&stats) };
        PreparedFrame { prepared: Some(prepared), stays: false, stats, ground }
    }

    /// The same, whose features stay: it may be asked for again.
    pub fn that_stays(self, stays: bool) -> Self {
        Self { stays, ..self }
    }
}

impl BandSource for PreparedFrame<'_> {
    type Error = Infallible;

    fn height(&self) -> usize {
        self.ground.denoised.height()
    }

    fn width(&self) -> usize {
        self.ground.denoised.width()
    }

    fn stats(&self) -> &FrameStats {
        &self.stats
    }

    fn has_composite(&self) -> bool {
        self.prepared.as_ref().is_some_and(|prepared| prepared.composite.is_some())
    }

    fn has_differences(&self) -> bool {
        self.prepared.as_ref().is_some_and(|prepared| prepared.differences.is_some())
    }

    /// # Panics
    /// When anything but the whole is asked for, or that a second time of a frame that does not stay.
    fn band(&mut self, rows: Range<usize>, _: usize) -> Result<BandInput<'_>, Infallible> {
        assert_eq!(rows, 0..self.height(), "a prepared frame comes whole");
        let prepared =
            if self.stays { self.prepared.as_ref().map(Cow::Borrowed) } else { self.prepared.take().map(Cow::Owned) };
        let prepared = prepared.expect("a prepared frame comes once");
        let Ground { denoised, fill } = &self.ground;
        let ground = Ground { denoised: Cow::Borrowed(denoised), fill: Cow::Borrowed(fill) };
        Ok(BandInput { prepared, inner: rows, ground })
    }

    /// # Panics
    /// When anything but the whole is asked for.
    fn ground(&mut self, rows: Range<usize>) -> Result<Ground<'_>, Infallible> {
        assert_eq!(rows, 0..self.height(), "a prepared frame comes whole");
        let Ground { denoised, fill } = &self.ground;
        Ok(Ground { denoised: Cow::Borrowed(denoised), fill: Cow::Borrowed(fill) })
    }
}
