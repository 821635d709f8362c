//! What a frame says of its own error, without a reference.
//!
//! For a correction μ̂^a that never saw y^b, ‖μ̂^a - y^b‖² - σ²(y^b) is an unbiased estimate of the
//! squared error (Eq. 8 with its variance term); ½ (y^a - y^b)² is an unbiased σ² of one half. Both
//! halves' estimates give that of their mean through
//! ‖½(p + q) - μ‖² = ½‖p - μ‖² + ½‖q - μ‖² - ¼‖p - q‖².
//!
//! The estimates here are in-sample: weights and shares of the correction were chosen on the same
//! y^a and y^b, by some twenty thousand numbers from some million, so they lean a little towards the
//! correction; and where few pixels carry most of the variance they are as uncertain as they say.

use crate::features::{DENOISED, RADIANCE};
use crate::image::Image;
use crate::objective::RELATIVE_FLOOR;
use crate::prepare::Prepared;
use rayon::prelude::*;
use std::ops::Range;

/// Side of the blocks whose scatter gives a standard error: noise is nearly independent between them.
pub const BLOCK: usize = 16;

/// A mean over the picture and its standard error.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Mean {
    pub value: f64,
    /// None below two blocks of pixels, of which no scatter can be told.
    pub standard_error: Option<f64>,
}

/// Self-supervised loss (Eq. 9) over the whole picture and both halves.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Losses {
    pub denoised: f64,
    pub corrected: f64,
}

/// Estimated relL2 of the mean of both halves, in the frame's own exposure: comparable with relL2 against a reference.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Estimate {
    pub denoised: Mean,
    pub corrected: Mean,
    /// The first less the second: what they share of their uncertainty is gone.
    pub gain: Mean,
}

/// Sums over blocks of pixels: those of a picture's bands, put after each other, are those of the
/// picture, when every band begins at a multiple of [`BLOCK`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Blocks(Vec<(f64, f64)>);

impl Blocks {
    /// Adds the blocks of the next band.
    pub fn append(&mut self, mut next: Blocks) {
        self.0.append(&mut next.0);
    }

    /// Differences from the blocks of another quantity over the same pixels.
    pub fn less(&self, other: &Blocks) -> Blocks {
        Blocks(self.0.iter().zip(&other.0).map(|(own, other)| (own.0 - other.0, own.1)).collect())
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

/// 1/(3N) Σ ½ (L̂(a) + L̂(b)) of a pair of pictures `[3, H, W]`, in the method's units, over `rows`.
pub fn loss(prepared: &Prepared, pair: &[Image], rows: Range<usize>) -> Blocks {
    sum_blocks(prepared, rows, |i| {
        (0..2).map(|h| 0.5 * weight(prepared, h, i) * squared_to(prepared, &pair[h], h, i)).sum()
    })
}

/// Estimate of how much smaller the error of `after` is than that of `before`:
/// L̂(before) - L̂(after), which needs no variance; over `rows`, with
/// [`crate::objective::shared_weight`].
pub fn gain(prepared: &Prepared, before: &[Image], after: &[Image], rows: Range<usize>) -> Blocks {
    sum_blocks(prepared, rows, |i| {
        (0..2)
            .map(|h| {
                let other = &prepared.halves[1 - h];
                let product: f64 = (0..3)
                    .map(|k| {
                        let (p, q) = (f64::from(before[h].plane(k)[i]), f64::from(after[h].plane(k)[i]));
                        let y = f64::from(other.plane(RADIANCE + k)[i]);
                        // (p - y)² - (q - y)² without the cancellation of two large squares.
                        (p - q) * (p + q - 2.0 * y)
                    })
                    .sum();
                0.5 * product
            })
            .sum::<f64>()
            * shared_weight(prepared, i)
    })
}

/// Estimated relL2 of the mean of a pair of pictures, in the frame's own exposure, over `rows`.
///
/// The full buffer's z stands in for the reference in the denominator: it is made of both halves
/// alike. Under a weight made of the half compared with, whose z is large where its noise is, the
/// squares of that half's noise weigh less than the variance that is to cancel them, and the
/// estimate falls below 0 in noisy frames; under a symmetric one they weigh the same.
pub fn estimate(prepared: &Prepared, pair: &[Image], rows: Range<usize>) -> Blocks {
    // In the method's units the 0.01 of relL2 is this much.
    let floor = f64::from(RELATIVE_FLOOR * prepared.exposure * prepared.exposure);
    sum_blocks(prepared, rows, |i| {
        let mean = (0..3).map(|k| f64::from(prepared.denoised.plane(k)[i])).sum::<f64>() / 3.0;
        let apart: f64 = (0..3).map(|k| f64::from(pair[0].plane(k)[i] - pair[1].plane(k)[i]).powi(2)).sum();
        let squared: f64 = (0..2).map(|h| 0.5 * squared_to(prepared, &pair[h], h, i)).sum();
        (squared - variance(prepared, i) - 0.25 * apart) / (mean * mean + floor)
    })
}

/// ‖x - y‖² at pixel i, y of the half that x of half `h` is compared with.
fn squared_to(prepared: &Prepared, x: &Image, h: usize, i: usize) -> f64 {
    let other = &prepared.halves[1 - h];
    (0..3).map(|k| f64::from(x.plane(k)[i] - other.plane(RADIANCE + k)[i]).powi(2)).sum()
}

/// 1ᵀσ² of y of one half at pixel i.
fn variance(prepared: &Prepared, i: usize) -> f64 {
    let y = |h: usize, k: usize| prepared.halves[h].plane(RADIANCE + k)[i];
    (0..3).map(|k| 0.5 * f64::from(y(0, k) - y(1, k)).powi(2)).sum()
}

/// 1 / (z̄² + 0.01), z of the half that half `h` is compared with.
fn weight(prepared: &Prepared, h: usize, i: usize) -> f64 {
    let z: f32 = (0..3).map(|k| prepared.halves[1 - h].plane(DENOISED + k)[i]).sum::<f32>() / 3.0;
    f64::from(1.0 / (z * z + RELATIVE_FLOOR))
}

/// [`crate::objective::shared_weight`] of a pixel.
fn shared_weight(prepared: &Prepared, i: usize) -> f64 {
    let z = |k: usize| 0.5 * (prepared.halves[0].plane(DENOISED + k)[i] + prepared.halves[1].plane(DENOISED + k)[i]);
    let mean = (z(0) + z(1) + z(2)) / 3.0;
    f64::from(1.0 / (mean * mean + RELATIVE_FLOOR))
}

/// Sums over the valid pixels of `rows` and three channels of `value(pixel)`.
fn sum_blocks(prepared: &Prepared, rows: Range<usize>, value: impl Fn(usize) -> f64 + Sync) -> Blocks {
    let width = prepared.width();
    let row_of_blocks = |top: usize| {
        let mut blocks = Vec::with_capacity(width.div_ceil(BLOCK));
        for left in (0..width).step_by(BLOCK) {
            let (mut sum, mut count) = (0.0, 0.0);
            for y in top..(top + BLOCK).min(rows.end) {
                for x in left..(left + BLOCK).min(width) {
                    let i = y * width + x;
                    if prepared.is_valid(i) {
                        sum += value(i);
                        count += 3.0;
                    }
                }
            }
            blocks.push((sum, count));
        }
        blocks
    };
    let tops: Vec<usize> = rows.clone().step_by(BLOCK).collect();
    let blocks: Vec<Vec<(f64, f64)>> = tops.into_par_iter().map(row_of_blocks).collect();
    Blocks(blocks.concat())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::features::{FEATURE_CHANNELS, FeatureSet};
    use crate::plan::Plan;
    use crate::prepare::Findings;
    use crate::rng::Rng;

    /// Share of a half's noise that its z keeps.
    const KEPT: f32 = 0.3;
    /// A z that follows so heavy a noise also weighs its own errors, by some half of them.
    const WITHIN: f64 = 2.0;

    /// Under weights of the half compared with, this estimate is -4 times the error.
    #[test]
    fn heavy_noise_that_z_follows_does_not_make_the_estimate_negative() {
        let rng = &mut Rng::new(3);
        let (height, width, truth) = (192, 256, 0.5);
        let mut halves = [0, 1].map(|_| Image::zeros(FEATURE_CHANNELS, height, width));
        for half in &mut halves {
            for i in 0..height * width {
                let y = -truth * (1.0 - rng.uniform()).max(1e-7).ln();
                for k in 0..3 {
                    half.plane_mut(RADIANCE + k)[i] = y;
                    half.plane_mut(DENOISED + k)[i] = truth + KEPT * (y - truth);
                }
            }
        }
        let z = [0, 1].map(|h| crate::objective::triple(&halves[h], DENOISED));
        let denoised = Image::mean_of(&z[0], &z[1]);
        let squared = denoised.data().iter().map(|v| f64::from(v - truth).powi(2)).sum::<f64>();
        let expected = squared / denoised.data().len() as f64 / f64::from(truth * truth + RELATIVE_FLOOR);
        let plan = Plan::everything(height, width);
        let halves = halves.map(std::sync::Arc::new);
        let (set, found) = (FeatureSet::NONE, Findings::default());
        let prepared = Prepared { exposure: 1.0, halves, denoised, valid: None, set, plan, found };
        let found = estimate(&prepared, &z, 0..height).mean();
        let ratio = found.value / expected;
        assert!((1.0 / WITHIN..WITHIN).contains(&ratio), "estimated {found:?}, true {expected}");
    }
}
