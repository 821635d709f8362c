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
    sum_blocks(prepared, RELATIVE_FLOOR, rows, |i, weights| {
        (0..2).map(|h| 0.5 * f64::from(weights[h]) * squared_to(prepared, &pair[h], h, i)).sum()
    })
}

/// Estimate of how much smaller the error of `after` is than that of `before`:
/// L̂(before) - L̂(after), which needs no variance; over `rows`.
pub fn gain(prepared: &Prepared, before: &[Image], after: &[Image], rows: Range<usize>) -> Blocks {
    sum_blocks(prepared, RELATIVE_FLOOR, rows, |i, weights| {
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
                0.5 * f64::from(weights[h]) * product
            })
            .sum()
    })
}

/// Estimated relL2 of the mean of a pair of pictures, in the frame's own exposure, over `rows`.
pub fn estimate(prepared: &Prepared, pair: &[Image], rows: Range<usize>) -> Blocks {
    // In the method's units the 0.01 of relL2 is this much.
    let floor = RELATIVE_FLOOR * prepared.exposure * prepared.exposure;
    sum_blocks(prepared, floor, rows, |i, weights| {
        let mut sum = 0.0;
        for h in 0..2 {
            sum += 0.5 * f64::from(weights[h]) * (squared_to(prepared, &pair[h], h, i) - variance(prepared, i));
        }
        let apart: f64 = (0..3).map(|k| f64::from(pair[0].plane(k)[i] - pair[1].plane(k)[i]).powi(2)).sum();
        sum - 0.25 * 0.5 * f64::from(weights[0] + weights[1]) * apart
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

/// Sums over the valid pixels of `rows` and three channels of `value(pixel, weights of both halves)`.
fn sum_blocks(
    prepared: &Prepared,
    floor: f32,
    rows: Range<usize>,
    value: impl Fn(usize, [f32; 2]) -> f64 + Sync,
) -> Blocks {
    let width = prepared.width();
    let weight = |half: usize, i: usize| {
        let z: f32 = (0..3).map(|k| prepared.halves[half].plane(DENOISED + k)[i]).sum::<f32>() / 3.0;
        1.0 / (z * z + floor)
    };
    let row_of_blocks = |top: usize| {
        let mut blocks = Vec::with_capacity(width.div_ceil(BLOCK));
        for left in (0..width).step_by(BLOCK) {
            let (mut sum, mut count) = (0.0, 0.0);
            for y in top..(top + BLOCK).min(rows.end) {
                for x in left..(left + BLOCK).min(width) {
                    let i = y * width + x;
                    if prepared.is_valid(i) {
                        // The weights for half h come from the other half.
                        sum += value(i, [weight(1, i), weight(0, i)]);
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
