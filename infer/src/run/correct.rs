//! One frame from pixels to pixels, in bands of rows of bounded memory.
//!
//! A band carries the rows around it that its own depend on (the network's radius, g_c's window, the
//! judge's neighbourhood); what is decided for the whole picture (exposure, features in use, whether
//! the correction stays) is decided once. So bands do not show.

use super::report::Seconds;
use crate::engine::{Engine, PlanError};
use sspc_core::estimate::{BLOCK, Estimate, Losses};
use sspc_core::finish::{Part, Tally, Verdict, finish_rows, judged_rows, margin, picture_of};
use sspc_core::frame::Frame;
use sspc_core::gc::Taps;
use sspc_core::image::Image;
use sspc_core::prepare::{Prepared, Survey};
use sspc_core::simd::Isa;
use std::ops::Range;
use std::time::Instant;

/// Memory that a band may take beside the frame itself.
const BAND_BYTES: usize = 640 << 20;
/// What a pixel of a band takes at the peak: features of both halves and of one full buffer, padded
/// windows, parameters of both halves and what is made of them, about a hundred f32.
const BYTES_PER_PIXEL: usize = 400;
/// Fewest rows of a band: below this the rows around it are most of the work.
const LEAST_ROWS: usize = 64;

/// Why a frame was not corrected.
#[derive(Debug, thiserror::Error)]
pub enum CorrectError {
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error("interrupted")]
    Interrupted,
}

/// A corrected frame and what was found.
pub struct Corrected {
    /// In the frame's own units, `[3, H, W]`.
    pub picture: Image,
    pub survey: Survey,
    pub loss: Losses,
    pub estimate: Estimate,
    /// Why the picture is the denoiser's, if it is.
    pub fallback: Option<String>,
    /// Mean share of the correction that the judge kept, 0..1.
    pub mean_share: f64,
    /// Share of the pixels that were computed at all, 0..1.
    pub active_share: f64,
}

/// Corrects a frame. `stop` is asked between the steps of every band.
///
/// # Errors
/// [`CorrectError`].
pub fn correct(
    engine: &Engine,
    isa: Isa,
    frame: &Frame,
    rows: Option<usize>,
    seconds: &mut Seconds,
    stop: &dyn Fn() -> bool,
) -> Result<Corrected, CorrectError> {
    let contract = &engine.model().contract;
    let taps = Taps::square(contract.window_radius);
    let begin = Instant::now();
    let survey = Survey::of(frame, contract.exposure).with_features_of(contract.features);
    seconds.features += begin.elapsed().as_secs_f64();

    let (height, width) = (frame.height(), frame.width());
    let around = (margin(&taps, contract.composition) + contract.shape.radius()).next_multiple_of(BLOCK);
    let step = rows.unwrap_or_else(|| band_rows(width, around)).next_multiple_of(BLOCK);
    let mut correction = Image::zeros(3, height, width);
    let (mut tally, mut kept, mut active) = (Tally::default(), 0.0, 0.0);
    for top in (0..height).step_by(step) {
        let band = top..(top + step).min(height);
        let work = Band { engine, isa, taps: &taps, frame, survey, around, stop };
        let (part, share_of_active) = work.correct(band.clone(), seconds)?;
        tally.append(part.tally);
        kept += part.share.data().iter().map(|&s| f64::from(s)).sum::<f64>();
        active += share_of_active * (band.len() * width) as f64;
        for c in 0..3 {
            correction.plane_mut(c)[band.start * width..band.end * width].copy_from_slice(part.correction.plane(c));
        }
    }
    let begin = Instant::now();
    let Verdict { loss, estimate, fallback } = tally.verdict(contract.composition);
    if fallback.is_some() {
        correction.data_mut().fill(0.0);
    }
    let picture = picture_of(frame, survey.exposure, survey.found.missing_pixels > 0, &correction);
    seconds.finish += begin.elapsed().as_secs_f64();
    let pixels = (height * width).max(1) as f64;
    Ok(Corrected {
        picture,
        survey,
        loss,
        estimate,
        fallback,
        mean_share: kept / pixels,
        active_share: active / pixels,
    })
}

/// Rows of a band that fit the memory, beside the rows around it.
fn band_rows(width: usize, around: usize) -> usize {
    let rows = BAND_BYTES / (BYTES_PER_PIXEL * width.max(1));
    rows.saturating_sub(2 * around).max(LEAST_ROWS)
}

/// What every band of a frame is corrected with.
struct Band<'a> {
    engine: &'a Engine,
    isa: Isa,
    taps: &'a Taps,
    frame: &'a Frame,
    survey: Survey,
    around: usize,
    stop: &'a dyn Fn() -> bool,
}

impl Band<'_> {
    /// The finished rows and the share of the band's pixels that were computed.
    fn correct(&self, rows: Range<usize>, seconds: &mut Seconds) -> Result<(Part, f64), CorrectError> {
        let contract = &self.engine.model().contract;
        let begin = Instant::now();
        let first = rows.start.saturating_sub(self.around);
        let last = (rows.end + self.around).min(self.frame.height());
        let prepared = Prepared::by_survey(&self.frame.rows(first, last - first), self.survey);
        seconds.features += begin.elapsed().as_secs_f64();

        let begin = Instant::now();
        let inner = rows.start - first..rows.end - first;
        let looked_at = judged_rows(contract.composition, &inner, prepared.height());
        let plan = prepared.plan.within_rows(looked_at);
        let mut parameters = Vec::new();
        for features in &prepared.halves {
            self.go_on()?;
            parameters.push(self.engine.parameters(features, &plan)?);
        }
        seconds.network += begin.elapsed().as_secs_f64();

        self.go_on()?;
        let begin = Instant::now();
        let both = [&parameters[0], &parameters[1]];
        let part = finish_rows(self.isa, contract.form, self.taps, contract.composition, &prepared, both, inner);
        seconds.finish += begin.elapsed().as_secs_f64();
        Ok((part, prepared.plan.active_share))
    }

    fn go_on(&self) -> Result<(), CorrectError> {
        if (self.stop)() { Err(CorrectError::Interrupted) } else { Ok(()) }
    }
}
