//! The one way from a frame and a network to the corrected picture, whole or in bands of bounded memory.
//!
//! A band carries the rows around it that its own depend on (the network's radius, g_c's window, the reach of the blend
//! weight); what is decided for the whole picture (exposure, features in use, whether the correction stays) is decided
//! once. So bands do not show. Programs differ in who gives the parameters ([`ParameterSource`]) and in where a band's
//! rows come from ([`BandSource`]).

use crate::compose::Composer;
use crate::composition::Composition;
use crate::estimate::BLOCK;
use crate::fill;
use crate::frame_stats::FrameStats;
use crate::frame_sums::{FrameSums, Verdict};
use crate::prepare::{Prepared, baseline};
use crate::tiles::ParameterSource;
use rayon::join;
use sspc_image::{Frame, Image};
use sspc_kernels::gc::Taps;
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use std::borrow::Cow;
use std::ops::Range;
use std::time::Instant;

/// Memory that a band may take beside what is held of the frame and the picture.
const BAND_BYTES: usize = 800 << 20;
/// What a pixel of a band takes at the peak: features of both halves, what is made of them, windows of the tiles at work, the
/// colours as read; about a hundred f32.
pub const BYTES_PER_PIXEL: usize = 440;
/// What each variant of z adds: three pictures, as read and in the method's units. The frame as one network sees it is
/// a copy of half of [`BYTES_PER_PIXEL`] beside it.
const BYTES_PER_VARIANT: usize = 2 * 3 * 3 * size_of::<f32>();
/// What the choice between the first network and the mean of several adds: the first's corrections and what it is judged by.
const BYTES_OF_CHOICE: usize = (3 * 3 + 7) * size_of::<f32>();
/// Fewest rows of a band: below this the rows around it are most of the work.
const LEAST_ROWS: usize = 64;

/// How a frame is corrected.
#[derive(Clone, Copy, Debug)]
pub struct CorrectionSettings {
    /// Instruction set of g_c.
    pub isa: Isa,
    /// Form of the parameters.
    pub form: Form,
    /// Radius of g_c's window, pixels.
    pub window_radius: usize,
    /// What the picture is made of.
    pub composition: Composition,
    /// Share of the weighed correction that is used, 0..1.
    pub strength: f32,
    /// Rows of a band, or as many as fit the memory.
    pub rows: Option<usize>,
    /// Whether training left out what [`crate::held_out`] says, so that it judges the picture; the frame comes whole then.
    pub judged_by_held_out: bool,
    /// Whether [`Corrected::maps`] are kept.
    pub keep_maps: bool,
}

/// Rows of a frame in the method's units, and what their picture is made of.
pub struct BandInput<'a> {
    /// The band's rows and those around it.
    pub prepared: Cow<'a, Prepared>,
    /// The band's own rows, among those of `prepared`.
    pub inner: Range<usize>,
    /// What the correction is added to.
    pub ground: Ground<'a>,
}

/// What a correction is added to: some rows of the denoiser's picture.
pub struct Ground<'a> {
    /// In the frame's units, `[3, rows, W]`; NaN and Inf included.
    pub denoised: Cow<'a, Image>,
    /// Values of its missing pixels, by their index.
    pub fill: Cow<'a, [(usize, [f32; 3])]>,
}

impl Ground<'_> {
    /// The ground of a frame's rows.
    pub fn of(frame: &Frame, stats: &FrameStats) -> Ground<'static> {
        let denoised = baseline(frame);
        let fill = Self::fill_of(&denoised, frame, stats);
        Ground { denoised: Cow::Owned(denoised.into_owned()), fill: Cow::Owned(fill) }
    }

    /// Values of the missing pixels of a frame's [`baseline`].
    pub(crate) fn fill_of(denoised: &Image, frame: &Frame, stats: &FrameStats) -> Vec<(usize, [f32; 3])> {
        let missing = stats.found.missing_pixels > 0;
        if missing { fill::values_from_sources(denoised, frame) } else { Vec::new() }
    }

    /// The picture with a correction `[3, rows, W]` added that is in units of `exposure` times its own: the denoiser's,
    /// bit for bit, wherever nothing is added.
    fn picture(&self, exposure: f32, correction: Option<&Image>) -> Image {
        let (inverse, denoised) = (1.0 / exposure, &*self.denoised);
        let mut picture = Image::from_rows(3, denoised.height(), denoised.width(), |k, y, row| {
            row.copy_from_slice(denoised.row(k, y));
            for (x, c) in row.iter_mut().zip(correction.map_or(&[][..], |correction| correction.row(k, y))) {
                // The method knows no negative light: what is out of gamut stays the denoiser's.
                *x = if *x < 0.0 || *c == 0.0 { *x } else { (*x + c * inverse).max(0.0) };
            }
        });
        fill::put(&mut picture, &self.fill);
        picture
    }
}

/// Where the rows of a frame come from.
pub trait BandSource {
    /// Why rows could not be had.
    type Error;

    /// Rows of the whole picture.
    fn height(&self) -> usize;

    /// Columns.
    fn width(&self) -> usize;

    /// What was decided for the whole frame.
    fn stats(&self) -> &FrameStats;

    /// Whether bands come with a composite of passes (METHOD (14d)).
    fn has_composite(&self) -> bool;

    /// Whether its rows come with differences of y.
    fn has_differences(&self) -> bool {
        false
    }

    /// Some rows, with `around` rows above and below them wherever the picture has; `around` is a multiple of
    /// [`BLOCK`]. Asked for once for each band.
    ///
    /// # Errors
    /// What reading can raise.
    fn band(&mut self, rows: Range<usize>, around: usize) -> Result<BandInput<'_>, Self::Error>;

    /// The ground of some rows by itself, again.
    ///
    /// # Errors
    /// What reading can raise.
    fn ground(&mut self, rows: Range<usize>) -> Result<Ground<'_>, Self::Error>;
}

/// Why a frame was not corrected.
#[derive(Debug)]
pub enum CorrectError<Bands, Parameters> {
    /// Rows could not be had.
    Bands(Bands),
    /// The network could not be run.
    Parameters(Parameters),
    /// It was asked to stop.
    Interrupted,
}

/// Wall-clock seconds of a correction.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct StageSeconds {
    /// Rows in the method's units, read where they are not held.
    pub features: f64,
    /// Parameters, g_c, weights and picture.
    pub correct: f64,
}

/// A corrected frame and what it says of itself.
pub struct Corrected {
    /// In the frame's own units, `[3, H, W]`.
    pub picture: Image,
    /// What the picture was judged by, where it was asked for.
    pub maps: Option<Maps>,
    /// The judgement of the whole.
    pub verdict: Verdict,
    /// Mean share of the correction that was used, strength included, 0..1.
    pub mean_share: f64,
    /// Share of the pixels that were computed at all, 0..1.
    pub active_share: f64,
    /// Mean weight of each network's correction; their sum is 1.
    pub network_weights: Vec<f64>,
    /// Mean share of the composite of passes in the correction, 0..1, where there is one.
    pub composite_share: Option<f64>,
    /// Where the time went.
    pub seconds: StageSeconds,
}

/// Pictures beside the corrected one.
#[derive(Clone, Debug)]
pub struct Maps {
    /// Share of the correction that was used, strength included, 0..1, `[1, H, W]`.
    pub share: Image,
    /// Mean of both halves, corrected as far as they judge each other, in the frame's own units, `[3, H, W]`: the picture
    /// that the estimate is of, unless the whole picture falls back.
    pub halves: Image,
}

/// Corrects a frame. `stop` is asked before every band.
///
/// # Errors
/// [`CorrectError`].
pub fn correct<B: BandSource, P: ParameterSource + ?Sized>(
    frame: &mut B,
    parameters: &P,
    how: &CorrectionSettings,
    stop: &dyn Fn() -> bool,
) -> Result<Corrected, CorrectError<B::Error, P::Error>> {
    let taps = Taps::square(how.window_radius);
    let CorrectionSettings { isa, form, composition, strength, judged_by_held_out, .. } = *how;
    let (has_composite, with_differences) = (frame.has_composite(), frame.has_differences());
    let composer =
        Composer { isa, form, taps: &taps, composition, strength, judged_by_held_out, has_composite, with_differences };
    let (height, width, exposure) = (frame.height(), frame.width(), frame.stats().exposure);
    let around = (composer.margin() + parameters.shape().radius()).next_multiple_of(BLOCK);
    let step = how.rows.unwrap_or_else(|| band_rows(width, around, parameters.networks())).next_multiple_of(BLOCK);
    let bands = || (0..height).step_by(step).map(|top| top..(top + step).min(height));
    let mut picture = Image::zeros(3, height, width);
    let mut maps =
        how.keep_maps.then(|| Maps { share: Image::zeros(1, height, width), halves: Image::zeros(3, height, width) });
    let mut seconds = StageSeconds::default();
    let (mut sums, mut kept, mut active, mut of_mean) = (FrameSums::default(), 0.0, 0.0, 0.0);
    let mut of_composite: Option<f64> = None;
    for rows in bands() {
        if stop() {
            return Err(CorrectError::Interrupted);
        }
        let begin = Instant::now();
        let BandInput { prepared, inner, ground } = frame.band(rows.clone(), around).map_err(CorrectError::Bands)?;
        let read = Instant::now();
        active += prepared.plan.active_share * (rows.len() * width) as f64;
        let band = composer.rows(&prepared, parameters, inner).map_err(CorrectError::Parameters)?;
        kept += band.share.data().iter().map(|&s| f64::from(s)).sum::<f64>();
        of_mean += band.weight_of_mean;
        of_composite = band.weight_of_composite.map(|of_band| of_composite.unwrap_or(0.0) + of_band).or(of_composite);
        sums.append(band.sums);
        let (of_band, ()) = join(|| ground.picture(exposure, Some(&band.correction)), || drop(prepared));
        match rows.len() == height {
            true => picture = of_band,
            false => picture.put_rows(rows.start, &of_band),
        }
        if let Some(maps) = &mut maps {
            let mut halves = band.halves;
            halves.data_mut().iter_mut().for_each(|v| *v /= exposure);
            maps.halves.put_rows(rows.start, &halves);
            maps.share.put_rows(rows.start, &band.share);
        }
        seconds.features += (read - begin).as_secs_f64();
        seconds.correct += read.elapsed().as_secs_f64();
    }
    let begin = Instant::now();
    let verdict = sums.verdict(composition, frame.stats().trust());
    if verdict.fallback.is_some() {
        kept = 0.0;
        maps.iter_mut().for_each(|maps| maps.share.data_mut().fill(0.0));
        for rows in bands() {
            let ground = frame.ground(rows.clone()).map_err(CorrectError::Bands)?;
            picture.put_rows(rows.start, &ground.picture(exposure, None));
        }
    }
    if frame.stats().found.missing_pixels > 0 {
        fill::grow_shut(&mut picture);
    }
    seconds.correct += begin.elapsed().as_secs_f64();
    let pixels = (height * width).max(1) as f64;
    let (networks, of_mean) = (parameters.networks(), of_mean / pixels);
    let weight = |k: usize| of_mean / networks as f64 + if k == 0 { 1.0 - of_mean } else { 0.0 };
    Ok(Corrected {
        picture,
        maps,
        verdict,
        mean_share: kept / pixels,
        active_share: active / pixels,
        network_weights: (0..networks).map(weight).collect(),
        composite_share: of_composite.map(|of_composite| of_composite / pixels),
        seconds,
    })
}

/// Whether a frame of this size fits the memory of a band, so that it need not be cut into several.
pub fn is_one_band(height: usize, width: usize, networks: usize) -> bool {
    height <= rows_in_memory(width, networks)
}

/// Rows of a band that fit the memory, beside the rows around it.
fn band_rows(width: usize, around: usize, networks: usize) -> usize {
    rows_in_memory(width, networks).saturating_sub(2 * around).max(LEAST_ROWS)
}

fn rows_in_memory(width: usize, networks: usize) -> usize {
    let of_variants =
        if networks > 1 { networks * BYTES_PER_VARIANT + BYTES_OF_CHOICE + BYTES_PER_PIXEL / 2 } else { 0 };
    BAND_BYTES / ((BYTES_PER_PIXEL + of_variants) * width.max(1))
}
