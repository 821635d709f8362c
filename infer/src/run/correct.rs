//! One frame from pixels to pixels, in bands of rows of bounded memory.
//!
//! A band carries the rows around it that its own depend on (the network's radius, g_c's window, the
//! judge's neighbourhood); what is decided for the whole picture (exposure, features in use, whether
//! the correction stays) is decided once. So bands do not show.

use super::report::Seconds;
use super::source::Rows;
use crate::engine::{Engine, PlanError};
use sspc_core::estimate::{BLOCK, Estimate, Losses};
use sspc_core::fill;
use sspc_core::finish::{Composition, Finish, Part, Tally, Verdict, judged_rows, margin, unfilled_picture};
use sspc_core::prepare::{Prepared, Survey, baseline};
use sspc_frames::error::Error;
use sspc_image::{Frame, Image};
use sspc_kernels::gc::Taps;
use sspc_kernels::simd::Isa;
use std::borrow::Cow;
use std::ops::Range;
use std::time::Instant;

/// Memory that a band may take beside what is held of the frame and the picture.
const BAND_BYTES: usize = 800 << 20;
/// What a pixel of a band takes at the peak: features of both halves, parameters of both halves, what is made of them,
/// windows of one half, the colours as read; about a hundred f32.
pub const BYTES_PER_PIXEL: usize = 440;
/// Fewest rows of a band: below this the rows around it are most of the work.
const LEAST_ROWS: usize = 64;

/// Why a frame was not corrected.
#[derive(Debug, thiserror::Error)]
pub enum CorrectError {
    #[error(transparent)]
    Plan(#[from] PlanError),
    /// Rows could not be read again.
    #[error(transparent)]
    Read(#[from] Error),
    #[error("interrupted")]
    Interrupted,
}

/// What is asked for beside the model and the frame.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Rows of a band, or as many as fit the memory.
    pub rows: Option<usize>,
    /// Share of the judged correction that is used, 0..1.
    pub strength: f32,
}

impl Default for Options {
    fn default() -> Self {
        Self { rows: None, strength: 1.0 }
    }
}

/// A corrected frame and what was found.
pub struct Corrected {
    /// In the frame's own units, `[3, H, W]`.
    pub picture: Image,
    pub survey: Survey,
    pub loss: Losses,
    /// The loss of the model's correction as it is, before any judgement.
    pub model_loss: f64,
    pub estimate: Estimate,
    /// Why the picture is the denoiser's, if it is.
    pub fallback: Option<String>,
    /// Mean share of the correction that was used, as the judge and strength have it, 0..1.
    pub mean_share: f64,
    /// Share of the pixels that were computed at all, 0..1.
    pub active_share: f64,
}

impl Corrected {
    /// In words that the model does not suit the frame: by the self-supervised loss its correction as it is comes out
    /// worse than the denoiser, as that of a model fitted to other scenes or noise would.
    pub fn unlike(&self, composition: Composition) -> Option<String> {
        let (model, denoiser) = (self.model_loss, self.loss.denoised);
        // A loss that is not a number is no better.
        if model <= denoiser {
            return None;
        }
        let outcome = match (&self.fallback, composition) {
            (Some(_), _) => "nothing of its correction was used".to_string(),
            (None, Composition::JudgedFullBuffer) => {
                format!("{:.0} % of its correction was used, where it helps", 100.0 * self.mean_share)
            }
            (None, Composition::MeanOfHalves) => {
                "the picture is as the model makes it, since it asks for no judgement".to_string()
            }
        };
        Some(format!(
            "the frame is unlike those that the model was fitted on: its loss is {model:.4}, the denoiser's {denoiser:.4}; {outcome}"
        ))
    }
}

/// Corrects a frame that is in memory; see [`correct_rows`].
///
/// # Errors
/// [`CorrectError`].
pub fn correct(
    engine: &Engine,
    isa: Isa,
    frame: &Frame,
    options: Options,
    seconds: &mut Seconds,
    stop: &dyn Fn() -> bool,
) -> Result<Corrected, CorrectError> {
    let survey = Survey::of(frame, engine.model().contract.exposure);
    correct_rows(engine, isa, frame, survey, options, seconds, stop)
}

/// Corrects a frame that was looked over. `stop` is asked between the steps of every band.
///
/// # Errors
/// [`CorrectError`].
pub fn correct_rows(
    engine: &Engine,
    isa: Isa,
    frame: &dyn Rows,
    survey: Survey,
    options: Options,
    seconds: &mut Seconds,
    stop: &dyn Fn() -> bool,
) -> Result<Corrected, CorrectError> {
    let contract = &engine.model().contract;
    let survey = survey.with_features_of(contract.features);
    let taps = Taps::square(contract.window_radius);
    let (height, width) = (frame.height(), frame.width());
    let around = (margin(&taps, contract.composition) + contract.shape.radius()).next_multiple_of(BLOCK);
    let step = options.rows.unwrap_or_else(|| band_rows(width, around)).next_multiple_of(BLOCK);
    let bands = || (0..height).step_by(step).map(|top| top..(top + step).min(height));
    let how =
        Finish { isa, form: contract.form, taps: &taps, composition: contract.composition, strength: options.strength };
    let mut picture = Image::zeros(3, height, width);
    let (mut tally, mut kept, mut active) = (Tally::default(), 0.0, 0.0);
    for band in bands() {
        let work = Band { engine, how, frame, survey, around, stop };
        let done = work.correct(band.clone(), seconds)?;
        tally.append(done.part.tally);
        kept += done.part.share.data().iter().map(|&s| f64::from(s)).sum::<f64>();
        active += done.active_share * (band.len() * width) as f64;
        picture.put_rows(band.start, &done.picture);
    }
    let begin = Instant::now();
    let Verdict { loss, model_loss, estimate, fallback } = tally.verdict(contract.composition);
    if fallback.is_some() {
        for band in bands() {
            let denoised = frame.rows(band.clone())?;
            let nothing = Image::zeros(3, band.len(), width);
            picture.put_rows(band.start, &picture_rows(&denoised, survey, &nothing));
        }
    }
    if survey.found.missing_pixels > 0 {
        fill::grow_shut(&mut picture);
    }
    seconds.finish += begin.elapsed().as_secs_f64();
    let pixels = (height * width).max(1) as f64;
    Ok(Corrected {
        picture,
        survey,
        loss,
        model_loss,
        estimate,
        fallback,
        mean_share: kept / pixels,
        active_share: active / pixels,
    })
}

/// The picture's rows of a frame's rows, filled from the frame where pixels are missing.
fn picture_rows(frame: &Frame, survey: Survey, correction: &Image) -> Image {
    let mut picture = unfilled_picture(&baseline(frame), survey.exposure, correction);
    if survey.found.missing_pixels > 0 {
        fill::fill_from_sources(&mut picture, frame);
    }
    picture
}

/// Rows of a band that fit the memory, beside the rows around it.
fn band_rows(width: usize, around: usize) -> usize {
    let rows = BAND_BYTES / (BYTES_PER_PIXEL * width.max(1));
    rows.saturating_sub(2 * around).max(LEAST_ROWS)
}

/// What every band of a frame is corrected with.
struct Band<'a> {
    engine: &'a Engine,
    how: Finish<'a>,
    frame: &'a dyn Rows,
    survey: Survey,
    around: usize,
    stop: &'a dyn Fn() -> bool,
}

/// A band's finished rows.
struct Done {
    part: Part,
    /// In the frame's own units.
    picture: Image,
    /// Share of the band's pixels that were computed.
    active_share: f64,
}

impl Band<'_> {
    fn correct(&self, rows: Range<usize>, seconds: &mut Seconds) -> Result<Done, CorrectError> {
        let contract = &self.engine.model().contract;
        let begin = Instant::now();
        let first = rows.start.saturating_sub(self.around);
        let last = (rows.end + self.around).min(self.frame.height());
        let inner = rows.start - first..rows.end - first;
        let frame = self.frame.rows(first..last)?;
        seconds.read += begin.elapsed().as_secs_f64();
        let begin = Instant::now();
        let mut prepared = Prepared::by_survey(&frame, self.survey);
        if !contract.composition.skips_still_blocks() {
            prepared = prepared.without_skips(self.survey);
        }
        let colours = match frame {
            Cow::Borrowed(whole) if inner.len() == whole.height() => Cow::Borrowed(whole),
            // The rest of what was read is of no use any more.
            band => Cow::Owned(band.colours(inner.start, inner.len())),
        };
        seconds.features += begin.elapsed().as_secs_f64();

        let begin = Instant::now();
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
        let part = self.how.rows(&prepared, both, inner);
        let picture = picture_rows(&colours, self.survey, &part.correction);
        seconds.finish += begin.elapsed().as_secs_f64();
        Ok(Done { part, picture, active_share: prepared.plan.active_share })
    }

    fn go_on(&self) -> Result<(), CorrectError> {
        if (self.stop)() { Err(CorrectError::Interrupted) } else { Ok(()) }
    }
}
