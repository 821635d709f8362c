//! Which picture of a pass is the best: place by place, the one whose halves agree most with the noisy pass of the other half.
//!
//! The noise of a half is independent of everything of the other, so ‖f^a - p^b‖² is the error of f^a and a term that is the
//! same for every candidate (as under the loss): a pass without noise stays as it is, an edge that the picture does not
//! show is kept by the small window, and noise is averaged over the whole one.

use super::PassRows;
use super::filtered::Candidates;
use crate::box_mean::box_mean;
use crate::objective::RELATIVE_FLOOR;
use crate::prepare::Prepared;
use sspc_image::{Image, Storage};
use std::ops::Range;

/// Radius of the neighbourhood that judges a pixel; two box means of this radius.
const JUDGE_RADIUS: usize = 5;
/// Radius over which choices fade into one another.
const FADE_RADIUS: usize = 2;
/// Radius over which a pass's own error is told.
const ERROR_RADIUS: usize = 3;
/// Rows around a pixel that it depends on beyond g_c's window.
pub(super) const REACH: usize = 2 * JUDGE_RADIUS + FADE_RADIUS + ERROR_RADIUS;
/// Relative noise of the mean of both halves below which there is none: rounding.
const STILL: f32 = 1e-3;
/// Relative noise at which half of a denoised pass's value is doubted.
const LITTLE_NOISE: f32 = 0.1;

/// A pass of some rows, in the units of its file.
pub(super) struct Chosen {
    /// `[3, rows, W]`.
    pub pass: Image,
    /// How wrong it may be: a standard deviation, `[1, rows, W]`.
    pub doubt: Image,
}

impl Chosen {
    /// The pass where it is not a part of anything: alpha, 0..1.
    pub fn of_itself(&self, storage: Storage) -> Image {
        let mut pass = self.pass.clone();
        pass.for_each_row(|_, _, row| row.iter_mut().for_each(|v| *v = storage.round(f64::from(v.clamp(0.0, 1.0)))));
        pass
    }
}

/// The best picture of a pass in the rows `inner` of a band.
pub(super) fn choose(prepared: &Prepared, of: Candidates, pass: &PassRows, inner: &Range<usize>) -> Chosen {
    let Candidates { noisy, whole, small, valid } = of;
    let exposure = prepared.exposure;
    let (height, width) = (valid.height(), valid.width());
    let weight = weight(&whole, &valid);
    let candidates = [&whole, &small, &noisy];
    let errors = candidates.map(|c| judged(disagreement(c, &noisy, &weight)));
    let best = |y: usize, x: usize| {
        let error = |j: usize| errors[j].at(0, y, x);
        (1..3).fold(0, |best, j| if error(j) < error(best) { j } else { best })
    };
    let share = |j: usize| {
        let is_best = Image::from_rows(1, height, width, |_, y, row| {
            row.iter_mut().enumerate().for_each(|(x, v)| *v = f32::from(best(y, x) == j));
        });
        box_mean(&is_best, FADE_RADIUS)
    };
    let shares = [0, 1, 2].map(share);
    let mixed = [0, 1].map(|h| {
        Image::from_rows(noisy[h].channels(), height, width, |c, y, row| {
            for (x, v) in row.iter_mut().enumerate() {
                *v = (0..3).map(|j| shares[j].at(0, y, x) * candidates[j][h].at(c, y, x)).sum();
            }
        })
    });
    let doubt = box_mean(&own_error(&mixed, &noisy, &valid), ERROR_RADIUS);
    let picture = Image::mean_of(&mixed[0], &mixed[1]);
    let (picture, doubt) = match &pass.denoised {
        None => (picture, doubt),
        Some(denoised) => beside_denoised(denoised, &picture, exposure, &noisy, &valid),
    };
    let cut = |image: &Image, units: f32, root: bool| {
        let mut rows = image.crop(inner.start, 0, inner.len(), width);
        rows.for_each_row(|_, _, row| {
            row.iter_mut().for_each(|v| *v = if root { v.max(0.0).sqrt() } else { *v } / units);
        });
        rows
    };
    Chosen { pass: cut(&picture, exposure, false), doubt: cut(&doubt, exposure, true) }
}

/// The denoised picture, but for places without noise, where `picture` is what both halves say; and the square of how wrong it
/// may be. Nobody judges it, so that is in proportion to its value, and less where the pass is little noisier than
/// [`LITTLE_NOISE`]: denoisers are right about such passes.
fn beside_denoised(
    denoised: &Image,
    picture: &Image,
    exposure: f32,
    noisy: &[Image; 2],
    valid: &Image,
) -> (Image, Image) {
    let (height, width, channels) = (valid.height(), valid.width(), picture.channels());
    let z = Image::from_rows(channels, height, width, |c, y, row| {
        for ((out, z), own) in row.iter_mut().zip(denoised.row(c, y)).zip(picture.row(c, y)) {
            *out = if z.is_finite() { z * exposure } else { *own };
        }
    });
    let mean_square = |value: &(dyn Fn(usize, usize, usize) -> f32 + Sync)| {
        Image::from_rows(1, height, width, |_, y, row| {
            for (x, v) in row.iter_mut().enumerate() {
                *v = (0..channels).map(|c| value(c, y, x).powi(2)).sum::<f32>() / channels as f32;
            }
        })
    };
    let noise = mean_square(&|c, y, x| 0.5 * (noisy[0].at(c, y, x) - noisy[1].at(c, y, x)));
    let square = mean_square(&|c, y, x| z.at(c, y, x));
    let noise = [ERROR_RADIUS, JUDGE_RADIUS].map(|radius| box_mean(&noise, radius));
    let size = [ERROR_RADIUS, JUDGE_RADIUS].map(|radius| box_mean(&square, radius));
    let is_still = |y: usize, x: usize| noise[1].at(0, y, x) <= STILL * STILL * size[1].at(0, y, x);
    let made = Image::from_rows(channels, height, width, |c, y, row| {
        for (x, v) in row.iter_mut().enumerate() {
            *v = if is_still(y, x) { picture.at(c, y, x) } else { z.at(c, y, x) };
        }
    });
    let doubt = Image::from_rows(1, height, width, |_, y, row| {
        for (x, v) in row.iter_mut().enumerate() {
            let relative = (noise[0].at(0, y, x) / size[0].at(0, y, x).max(f32::MIN_POSITIVE)).sqrt();
            let factor = if is_still(y, x) { 0.0 } else { relative / (relative + LITTLE_NOISE) };
            *v = square.at(0, y, x) * factor * factor;
        }
    });
    (made, doubt)
}

/// 1 / (mean² + ε) of a pass, 0 where it is missing.
fn weight(whole: &[Image; 2], valid: &Image) -> Image {
    let channels = whole[0].channels();
    let smooth = box_mean(&Image::mean_of(&whole[0], &whole[1]), JUDGE_RADIUS);
    Image::from_rows(1, valid.height(), valid.width(), |_, y, row| {
        let valid = valid.row(0, y);
        for (x, w) in row.iter_mut().enumerate() {
            let mean = (0..channels).map(|c| smooth.at(c, y, x)).sum::<f32>() / channels as f32;
            *w = valid[x] / (mean * mean + RELATIVE_FLOOR);
        }
    })
}

/// Weighted squared distance of each half's picture from the other half's noisy pass.
fn disagreement(picture: &[Image; 2], noisy: &[Image; 2], weight: &Image) -> Image {
    squares(
        weight,
        |c, y, x| {
            (picture[0].at(c, y, x) - noisy[1].at(c, y, x)).powi(2)
                + (picture[1].at(c, y, x) - noisy[0].at(c, y, x)).powi(2)
        },
        noisy[0].channels(),
    )
}

fn squares(weight: &Image, of: impl Fn(usize, usize, usize) -> f32 + Sync, channels: usize) -> Image {
    Image::from_rows(1, weight.height(), weight.width(), |_, y, row| {
        let weight = weight.row(0, y);
        for (x, v) in row.iter_mut().enumerate().filter(|(x, _)| weight[*x] > 0.0) {
            *v = weight[x] * (0..channels).map(|c| of(c, y, x)).sum::<f32>();
        }
    })
}

fn judged(error: Image) -> Image {
    box_mean(&box_mean(&error, JUDGE_RADIUS), JUDGE_RADIUS)
}

/// Squared error of the mean of both halves' pictures, a value of one channel: their variance, and what both are wrong by.
fn own_error(picture: &[Image; 2], noisy: &[Image; 2], valid: &Image) -> Image {
    let channels = noisy[0].channels();
    Image::from_rows(1, valid.height(), valid.width(), |_, y, row| {
        let valid = valid.row(0, y);
        for (x, v) in row.iter_mut().enumerate() {
            let of = |c: usize| {
                let [a, b] = [0, 1].map(|h| picture[h].at(c, y, x));
                let both = (noisy[0].at(c, y, x) - a) * (noisy[1].at(c, y, x) - b);
                0.25 * (a - b).powi(2) + if valid[x] > 0.0 { both } else { 0.0 }
            };
            *v = (0..channels).map(of).sum::<f32>() / channels as f32;
        }
    })
}
