//! What a frame says of its own error, without a reference.
//!
//! For a correction μ̂^a that never saw y^b, ‖μ̂^a - y^b‖² - σ²(y^b) is an unbiased estimate of the
//! squared error (Eq. 8 with its variance term); ½ (y^a - y^b)² is an unbiased σ² of one half. Both
//! halves' estimates give that of their mean through
//! ‖½(p + q) - μ‖² = ½‖p - μ‖² + ½‖q - μ‖² - ¼‖p - q‖².
//!
//! With weights w, ‖w_a p + w_b q - μ‖² = w_a‖p - μ‖² + w_b‖q - μ‖² - w_a w_b‖p - q‖², and by how much the first two differ,
//! E\[‖p‖² - 2p·y^b - ‖q‖² + 2q·y^a\] says without any variance. (Variances by the samples, w_b and w_a of
//! E‖y^a - y^b‖², are unbiased too, and were useless under fireflies: they lie in one half or the other.)
//!
//! That is the error of the **mean of both halves**. The picture that is delivered starts from the full buffer's z and
//! has 0.63 to 1.02 times that error: no unbiased estimate of its own is known, since it is made of all samples.
//!
//! relL2 divides by the reference, r̄² + 0.01, and the frame has only stand-ins for it. Where a stand-in is too bright, errors
//! count for less, so estimates are too small by up to a quarter with the denoiser's picture and by half of that with the
//! finished one. With L the part of the denoiser's squared error that is left in the finished picture, and what a stand-in does
//! taken as proportional to its own squared error, the estimate under the reference lies beyond that under the finished picture
//! by L / (1 - L) of what it moved between both. It is found anywhere from nowhere to there, so [`Estimate::of`] goes half the
//! way, and is as unsure as that is long. (On eleven frames of two renderers the whole way is best, on eight of other scenes,
//! where fireflies decide, none of it.) Where the estimate falls, noise of y that z follows is at work: there is no step.
//!
//! The correction was trained on y^b, so its estimate is too small as well; [`held_out_gain`] is free of that.

use crate::held_out::is_held_out;
use crate::objective::{RELATIVE_FLOOR, weight_of};
use crate::prepare::Prepared;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;
use std::ops::Range;

/// Side of the blocks whose scatter gives a standard error: noise is nearly independent between them.
/// (Larger ones measure how the error changes over the picture, and were not better calibrated.)
pub const BLOCK: usize = 16;

/// A mean over the picture and its standard error.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Mean {
    /// The mean.
    pub value: f64,
    /// None where a variance cannot be had: below two blocks of pixels, of an estimate where no block has two pixels.
    pub standard_error: Option<f64>,
}

/// Self-supervised loss (Eq. 9, divided as [`crate::objective::own_weight`] says) over the whole picture and both halves.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Losses {
    /// Of z.
    pub denoised: f64,
    /// Of μ̂.
    pub corrected: f64,
}

/// Estimated relL2 of the mean of both halves, in the frame's own exposure: comparable with relL2 against a reference.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Estimate {
    /// Of z.
    pub denoised: Mean,
    /// Of the corrected picture.
    pub corrected: Mean,
    /// The first less the second: what they share of their uncertainty is gone.
    pub gain: Mean,
}

/// Largest part of the denoiser's error that is taken to be left when estimates are carried on to the reference: they go no
/// further than they moved.
pub const MOST_LEFT: f64 = 2.0 / 3.0;
/// How much of the step from the finished picture's denominator to the reference's is taken; it is as unsure as it is long.
pub const STEP: f64 = 0.5;
/// What of the gain is the training's on the same y, and how unsure that is: parts of the gain. (Of the gain under the
/// reference's own denominator -0.08 to 0.15 are, over eleven frames and three presets.)
pub const BY_TRAINING: (f64, f64) = (0.03, 0.06);
/// What every estimate is unsure by at least, as a part of it.
pub const ALWAYS_UNSURE: f64 = 0.05;

impl Estimate {
    /// What sums over a picture say of z, of the corrected picture, and of their difference, the gain. Where the picture is
    /// not `improved`, nothing tells how far a stand-in is from the reference: there is no step.
    ///
    /// Standard errors are of noise, by the scatter of pixels within blocks ([`Errors::noise`]), of the step to the reference's
    /// denominator, and of what training takes for a gain.
    pub fn of(denoised: &Errors, corrected: &Errors, gain: &Errors, improved: bool) -> Self {
        let [of_z, of_x] = [denoised, corrected].map(|errors| errors.finished.mean().value);
        let left = if of_z > 0.0 && improved { (of_x / of_z).clamp(0.0, MOST_LEFT) } else { 0.0 };
        // How far it goes, and how unsure that is.
        let step = |errors: &Errors| match errors.moved() {
            moved if moved > 0.0 && improved => {
                let step = STEP * moved * left / (1.0 - left);
                (step, step)
            }
            moved => (0.0, moved),
        };
        let [(step_z, unsure_z), (step_x, unsure_x)] = [denoised, corrected].map(step);
        let (of_z, of_x) = (of_z + step_z, of_x + step_x);
        let (by_training, unsure) = (BY_TRAINING.0 * (of_z - of_x), BY_TRAINING.1 * (of_z - of_x));
        let mean = |value: f64, step: f64, training: f64, errors: &Errors| {
            let of_value = |noise: f64| noise.hypot(step).hypot(training).hypot(ALWAYS_UNSURE * value);
            Mean { value, standard_error: errors.noise().map(of_value) }
        };
        Self {
            denoised: mean(of_z, unsure_z, 0.0, denoised),
            corrected: mean(of_x + by_training, unsure_x, unsure, corrected),
            gain: mean(of_z - of_x - by_training, unsure_z - unsure_x, unsure, gain),
        }
    }
}

/// Sums over blocks of pixels: those of a picture's bands, put after each other, are those of the
/// picture, when every band begins at a multiple of [`BLOCK`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Blocks(pub(crate) Vec<(f64, f64)>);

impl Blocks {
    /// Adds the blocks of the next band.
    pub fn append(&mut self, mut next: Blocks) {
        self.0.append(&mut next.0);
    }

    /// How many there are.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The mean per pixel and channel, with a standard error from the scatter of blocks.
    pub fn mean(&self) -> Mean {
        let count: f64 = self.0.iter().map(|b| b.1).sum();
        let mean = if count > 0.0 { self.0.iter().map(|b| b.0).sum::<f64>() / count } else { 0.0 };
        let scatter: f64 = self.0.iter().map(|(sum, n)| (sum - mean * n).powi(2)).sum();
        let n = self.0.len() as f64;
        let standard_error = (n > 1.0 && count > 0.0).then(|| (scatter * n / (n - 1.0)).sqrt() / count);
        Mean { value: mean, standard_error }
    }
}

/// Sums of an error's estimate over blocks, under the denominators of two pictures.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Errors {
    pub(crate) finished: Blocks,
    pub(crate) denoised: Blocks,
    /// Squares of the pixels' values under the first.
    pub(crate) squares: Vec<f64>,
}

impl Errors {
    /// Adds the blocks of the next band.
    pub fn append(&mut self, next: Errors) {
        self.finished.append(next.finished);
        self.denoised.append(next.denoised);
        self.squares.extend(next.squares);
    }

    /// The mean under the finished picture's denominator. Its standard error is made of the scatter of
    /// blocks, which holds how the error changes over the picture, and of what the choice of the denominator does: more
    /// than the estimate is unsure by.
    pub fn mean(&self) -> Mean {
        let mean = self.finished.mean();
        Mean { standard_error: mean.standard_error.map(|scatter| scatter.hypot(self.moved())), ..mean }
    }

    /// Those of an error that is 0 everywhere, over the same pixels.
    pub(crate) fn nothing(&self) -> Errors {
        let zero = Blocks(self.finished.0.iter().map(|(_, count)| (0.0, *count)).collect());
        Errors { denoised: zero.clone(), squares: vec![0.0; zero.len()], finished: zero }
    }

    /// How far the mean moves from the denoised picture's denominator to the finished one's.
    fn moved(&self) -> f64 {
        self.finished.mean().value - self.denoised.mean().value
    }

    /// Standard error of the mean by the scatter of pixels within blocks: the noise of y is independent between them. None
    /// where no block has two pixels.
    pub fn noise(&self) -> Option<f64> {
        let (mut scatter, mut values, mut told) = (0.0, 0.0, false);
        for ((sum, count), squares) in self.finished.0.iter().zip(&self.squares) {
            let pixels = count / 3.0;
            values += count;
            if pixels > 1.0 {
                told = true;
                scatter += (squares - sum * sum / pixels).max(0.0) * pixels / (pixels - 1.0);
            }
        }
        told.then(|| scatter.sqrt() / values)
    }
}

/// Fall of the loss from the denoised halves to those corrected by `share` of the way to `corrected`, over the pixels of a
/// whole picture that training left out ([`crate::held_out`]).
pub fn held_out_gain(prepared: &Prepared, corrected: &[Image; 2], share: &Image) -> Blocks {
    let width = prepared.width();
    let of_half = |h: usize, i: usize| {
        let of_channel = |k: usize| {
            let z = f64::from(prepared.halves[h].plane(DENOISED + k)[i]);
            let step = f64::from(share.plane(0)[i]) * (f64::from(corrected[h].plane(k)[i]) - z);
            // What is below 0 is cut off in the picture.
            let step = step.max(-z);
            step * (2.0 * (f64::from(prepared.target(h, k, i)) - z) - step)
        };
        0.5 * weight(prepared, h, i) * (0..3).map(of_channel).sum::<f64>()
    };
    let held_out = |i: usize| is_held_out(i / width, i % width);
    let [blocks] =
        sum_blocks(prepared, 0..prepared.height(), |i| [if held_out(i) { of_half(0, i) + of_half(1, i) } else { 0.0 }]);
    let columns = width.div_ceil(BLOCK);
    let kept = blocks.0.into_iter().enumerate();
    let kept = kept.filter(|(at, block)| is_held_out(at / columns * BLOCK, at % columns * BLOCK) && block.1 > 0.0);
    Blocks(kept.map(|(_, block)| block).collect())
}

/// [`crate::objective::own_weight`] of half `h` at pixel i.
fn weight(prepared: &Prepared, h: usize, i: usize) -> f64 {
    let z = std::array::from_fn(|k| prepared.halves[h].plane(DENOISED + k)[i]);
    f64::from(weight_of(z, RELATIVE_FLOOR))
}

/// Sums over the valid pixels of `rows` and three channels of the quantities `values(pixel)`.
fn sum_blocks<const N: usize>(
    prepared: &Prepared,
    rows: Range<usize>,
    values: impl Fn(usize) -> [f64; N] + Sync,
) -> [Blocks; N] {
    let width = prepared.width();
    let row_of_blocks = |top: usize| {
        let mut blocks = Vec::with_capacity(width.div_ceil(BLOCK));
        for left in (0..width).step_by(BLOCK) {
            let (mut sums, mut count) = ([0.0; N], 0.0);
            for y in top..(top + BLOCK).min(rows.end) {
                for x in left..(left + BLOCK).min(width) {
                    let i = y * width + x;
                    if prepared.is_valid(i) {
                        sums.iter_mut().zip(values(i)).for_each(|(sum, value)| *sum += value);
                        count += 3.0;
                    }
                }
            }
            blocks.push((sums, count));
        }
        blocks
    };
    let tops: Vec<usize> = rows.clone().step_by(BLOCK).collect();
    let blocks: Vec<Vec<([f64; N], f64)>> = tops.into_par_iter().map(row_of_blocks).collect();
    std::array::from_fn(|n| Blocks(blocks.iter().flatten().map(|(sums, count)| (sums[n], *count)).collect()))
}

#[cfg(test)]
mod tests;
