//! Additive passes (lights, lobes) of a corrected picture: each is corrected, and they add up to it, pixel by pixel.
//!
//! In the order of the data, for a band of rows:
//!
//! | module | step |
//! |---|---|
//! | `filtered` | each pass's halves averaged by g_c's own weights, over the whole window and a small one |
//! | `choice` | of these, the pass's own noisy halves and a denoised picture of it where there is one: what the halves agree on |
//! | `shares` | what the passes lack of the picture, shared out among them; rounding that does not break the sum |
//!
//! The picture is finished before: whatever it is made of (the correction, the denoiser's where that falls back or nothing
//! is computed, filled pixels), the passes are parts of it.

mod choice;
mod filtered;
mod shares;

use crate::correct::{BandSource, CorrectionSettings};
use crate::plan::Plan;
use crate::tiles::ParameterSource;
use crate::trust::Trust;
use choice::{Chosen, choose};
use filtered::Filter;
use shares::share_out;
use sspc_image::{Image, Storage};
use sspc_kernels::gc::Taps;
use std::ops::Range;

/// Memory that a band may take.
const BAND_BYTES: usize = 384 << 20;
/// What a pixel of a band takes of each pass: both halves, as they are and averaged over two windows.
const BYTES_PER_PASS: usize = 3 * 2 * 3 * size_of::<f32>();
/// Fewest rows of a band.
const LEAST_ROWS: usize = 48;

/// Which passes there are.
#[derive(Clone, Debug, Default)]
pub struct Layout {
    /// Sets of passes, one after another; those of a set add up to the picture.
    pub sets: Vec<Range<usize>>,
    /// How each pass is kept.
    pub storage: Vec<Storage>,
}

/// One pass in some rows, in the units of its file.
#[derive(Clone, Debug)]
pub struct PassRows {
    /// Of half a and of half b, `[3, rows, W]`; of alpha `[1, rows, W]`. Of any sign; NaN and Inf count as missing.
    pub halves: [Image; 2],
    /// What the pass is multiplied by before it is added, as it will be written, `[3, rows, W]`.
    pub colour: Option<Image>,
    /// A denoised picture of the pass, of all samples.
    pub denoised: Option<Image>,
}

/// Where passes come from.
pub trait PassSource {
    /// Why rows could not be had.
    type Error;

    /// Which passes there are.
    fn layout(&self) -> &Layout;

    /// Some rows of every pass, in the layout's order.
    ///
    /// # Errors
    /// What reading can raise.
    fn rows(&mut self, rows: Range<usize>) -> Result<Vec<PassRows>, Self::Error>;
}

/// Why passes were not corrected.
#[derive(Debug)]
pub enum SplitError<Bands, Parameters, Passes> {
    /// Rows of the frame could not be had.
    Bands(Bands),
    /// Rows of passes could not be had.
    Passes(Passes),
    /// The network could not be run.
    Parameters(Parameters),
    /// It was asked to stop.
    Interrupted,
}

/// How well the passes add up, over all pixels and sets.
#[derive(Clone, Copy, Debug, Default, serde::Serialize)]
pub struct SumReport {
    /// Largest |Σ passes - picture| / |picture| where the picture is above 1e-4 of its largest value.
    pub largest_error: f64,
    /// Values that no pass can take, because all of them multiply a colour that is 0 there.
    pub unplaced: usize,
}

/// The passes of `picture` (`[3, H, W]`, as it will be stored): each is given to `put` in bands, by its number
/// and its first row. `stop` is asked before every band.
///
/// # Errors
/// [`SplitError`].
pub fn split<B: BandSource, P: ParameterSource + ?Sized, S: PassSource>(
    frame: &mut B,
    parameters: &P,
    how: &CorrectionSettings,
    picture: &Image,
    passes: &mut S,
    stop: &dyn Fn() -> bool,
    mut put: impl FnMut(usize, usize, &Image),
) -> Result<SumReport, SplitError<B::Error, P::Error, S::Error>> {
    let (height, width) = (frame.height(), frame.width());
    let taps = Taps::square(how.window_radius);
    let filter = Filter { isa: how.isa, form: how.form, taps: &taps };
    let reach = taps.radius() + choice::REACH + parameters.shape().radius();
    let around = reach.next_multiple_of(crate::estimate::BLOCK);
    let layout = passes.layout().clone();
    let frame_trust = frame.stats().trust();
    let mut report = SumReport::default();
    let largest = picture.data().iter().fold(0.0f32, |largest, v| largest.max(v.abs()));
    let fitting = BAND_BYTES / (BYTES_PER_PASS * layout.storage.len().max(1) * width.max(1));
    let fitting = fitting.saturating_sub(2 * around).max(LEAST_ROWS);
    let step = how.rows.unwrap_or(fitting).next_multiple_of(crate::estimate::BLOCK);
    for top in (0..height).step_by(step) {
        if stop() {
            return Err(SplitError::Interrupted);
        }
        let rows = top..(top + step).min(height);
        let band = frame.band(rows.clone(), around).map_err(SplitError::Bands)?;
        let first = rows.start - band.inner.start;
        let of_band = passes.rows(first..first + band.prepared.height()).map_err(SplitError::Passes)?;
        // Halves that are not independent are not corrected, and nothing of the frame is planned.
        let everywhere = matches!(frame_trust, Trust::None(_)).then(|| Plan::everything(band.prepared.height(), width));
        let computed = everywhere.as_ref().unwrap_or(&band.prepared.plan);
        let (mut halves, mut denoised, mut colours) = (Vec::new(), Vec::new(), Vec::new());
        for pass in of_band {
            halves.push(pass.halves);
            denoised.push(pass.denoised);
            colours.push(pass.colour.map(|colour| colour.crop(band.inner.start, 0, rows.len(), width)));
        }
        let candidates = filter.run(&band.prepared, parameters, computed, halves).map_err(SplitError::Parameters)?;
        let chosen = candidates.into_iter().zip(denoised);
        let chosen: Vec<Chosen> =
            chosen.map(|(of_pass, denoised)| choose(&band.prepared, of_pass, denoised.as_ref(), &band.inner)).collect();
        let picture = picture.crop(rows.start, 0, rows.len(), width);
        for set in &layout.sets {
            let stored =
                share_out(&picture, &chosen[set.clone()], &colours[set.clone()], &layout.storage[set.clone()], largest);
            report.largest_error = report.largest_error.max(stored.largest_error);
            report.unplaced += stored.unplaced;
            for (k, image) in set.clone().zip(&stored.passes) {
                put(k, rows.start, image);
            }
        }
        for k in (0..chosen.len()).filter(|k| !layout.sets.iter().any(|set| set.contains(k))) {
            put(k, rows.start, &chosen[k].of_itself(layout.storage[k]));
        }
    }
    Ok(report)
}
