//! Where a frame's rows come from: memory, or its files again and again.

use sspc_core::survey::{Exposure, Survey};
use sspc_frames::OpenFrame;
use sspc_frames::error::Error;
use sspc_image::Frame;
use std::borrow::Cow;
use std::ops::Range;

/// Most memory that a frame may take that is held whole; larger ones are read in bands.
const HELD_BYTES: usize = 512 << 20;
/// Rows of a band that is looked over.
const LOOKED_AT: usize = 64;

/// Something that rows of a frame can be asked of.
pub trait Rows {
    fn height(&self) -> usize;
    fn width(&self) -> usize;

    /// Some rows of every role.
    ///
    /// # Errors
    /// What reading a file can raise.
    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Frame>, Error>;
}

impl Rows for Frame {
    fn height(&self) -> usize {
        Frame::height(self)
    }

    fn width(&self) -> usize {
        Frame::width(self)
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Frame>, Error> {
        Ok(match rows.len() == Frame::height(self) {
            true => Cow::Borrowed(self),
            false => Cow::Owned(Frame::rows(self, rows.start, rows.len())),
        })
    }
}

impl Rows for OpenFrame {
    fn height(&self) -> usize {
        OpenFrame::height(self)
    }

    fn width(&self) -> usize {
        OpenFrame::width(self)
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Frame>, Error> {
        OpenFrame::rows(self, rows).map(Cow::Owned)
    }
}

/// A frame that was looked over.
pub struct Surveyed {
    pub rows: Box<dyn Rows>,
    pub survey: Survey,
    /// What a person should know.
    pub warnings: Vec<String>,
}

impl Surveyed {
    /// Reads a frame, whole when it is small enough, and looks it over.
    ///
    /// # Errors
    /// What reading a file can raise, and halves that cannot be used.
    pub fn read(open: OpenFrame, exposure: Exposure) -> Result<Self, Error> {
        let bytes = open.planes() * open.height() * open.width() * size_of::<f32>();
        if bytes > HELD_BYTES { Self::in_bands(open, exposure) } else { Self::held(&open, exposure) }
    }

    fn held(open: &OpenFrame, exposure: Exposure) -> Result<Self, Error> {
        let all = 0..open.height();
        let frame = open.rows(all.clone())?;
        let mut inspection = open.inspection();
        let (survey, ()) = rayon::join(|| Survey::of(&frame, exposure), || inspection.look(&frame, 0, all));
        let warnings = open.warnings(&inspection)?;
        Ok(Self { rows: Box::new(frame), survey, warnings })
    }

    /// The same for a frame of any size: what is looked over is forgotten.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn in_bands(open: OpenFrame, exposure: Exposure) -> Result<Self, Error> {
        let (height, width) = (open.height(), open.width());
        let mut inspection = open.inspection();
        let mut inspected = false;
        let survey = Survey::of_bands(height * width, exposure, |look| {
            for top in (0..height).step_by(LOOKED_AT) {
                let rows = top..(top + LOOKED_AT).min(height);
                // A row more on either side for differences between neighbours.
                let around = rows.start.saturating_sub(1)..(rows.end + 1).min(height);
                let band = open.rows(around.clone())?;
                if !inspected {
                    inspection.look(&band, around.start, rows.clone());
                }
                look(&band.rows(rows.start - around.start, rows.len()));
            }
            inspected = true;
            Ok::<(), Error>(())
        })?;
        let warnings = open.warnings(&inspection)?;
        Ok(Self { rows: Box::new(open), survey, warnings })
    }
}
