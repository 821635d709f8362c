//! Which picture of a pass is the best: place by place, the one whose halves agree most with the noisy pass of the other half.
//!
//! The noise of a half is independent of everything of the other, so ‖f^a - p^b‖² is the error of f^a and a term that is the
//! same for every candidate (as under the loss): a pass without noise stays as it is, an edge that the picture does not
//! show is kept by the small window, and noise is averaged over the whole one. What is not left to them is how wrong a pass may be
//! in the end: measured so, noise of the measure gave dim passes the differences of bright ones, and errors doubled.

use super::filtered::Candidates;
use crate::objective::RELATIVE_FLOOR;
use crate::prepare::Prepared;
use sspc_image::{HalfWeights, Image, Storage, box_mean};
use std::ops::Range;

/// Radius of the neighbourhood that judges a pixel; two box means of this radius.
const JUDGE_RADIUS: usize = 5;
/// Radius over which choices fade into one another.
const FADE_RADIUS: usize = 2;
/// Radius over which a pass's noise is averaged.
const NOISE_RADIUS: usize = 3;
/// Rows around a pixel that it depends on beyond g_c's window.
pub(super) const REACH: usize = 2 * JUDGE_RADIUS + FADE_RADIUS + NOISE_RADIUS;
/// Relative noise of the mean of both halves below which there is none: rounding.
const STILL: f32 = 1e-3;
/// Standard deviations of its noise by which both halves must outshine a pass's picture to stand in its place.
const CERTAIN: f32 = 8.0;
/// Relative noise at which half of a pass's value is doubted.
const LITTLE_NOISE: f32 = 0.1;

/// A pass of some rows, in the units of its file.
pub(super) struct Chosen {
    /// `[3, rows, W]`.
    pub pass: Image,
    /// How wrong it may be, in proportion, `[1, rows, W]`.
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

/// The best picture of a pass in the rows `inner` of a band; `denoised` is one in the units of its file.
pub(super) fn choose(prepared: &Prepared, of: Candidates, denoised: Option<&Image>, inner: &Range<usize>) -> Chosen {
    let Candidates { noisy, whole, small, valid } = of;
    let (exposure, weights) = (prepared.exposure, prepared.weights);
    let (height, width) = (valid.height(), valid.width());
    let weight = weight(&whole, &valid, weights);
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
            for (shares, candidate) in shares.iter().zip(candidates) {
                let terms = shares.row(0, y).iter().zip(candidate[h].row(c, y));
                row.iter_mut().zip(terms).for_each(|(v, (share, value))| *v += share * value);
            }
        })
    });
    let mut picture = weights.mean_of(&mixed[0], &mixed[1]);
    if let Some(denoised) = denoised {
        picture = beside_denoised(denoised, &picture, (exposure, weights), &noisy);
    }
    keep_certain(&mut picture, &noisy, weights);
    let mut doubt = doubt(&picture, &noisy, weights);
    for image in [&mut picture, &mut doubt] {
        *image = image.crop(inner.start, 0, inner.len(), width);
        image.for_each_row(|_, _, row| row.iter_mut().for_each(|v| *v /= exposure));
    }
    Chosen { pass: picture, doubt }
}

/// The denoised picture, but for places without noise, where `picture` is what both halves say.
fn beside_denoised(
    denoised: &Image,
    picture: &Image,
    (exposure, weights): (f32, HalfWeights),
    noisy: &[Image; 2],
) -> Image {
    let noise = box_mean(&noise(noisy, weights), JUDGE_RADIUS);
    let size = box_mean(&mean_square(picture), JUDGE_RADIUS);
    Image::from_rows(picture.channels(), picture.height(), picture.width(), |c, y, row| {
        let (denoised, own) = (denoised.row(c, y), picture.row(c, y));
        for (x, v) in row.iter_mut().enumerate() {
            let is_still = noise.at(0, y, x) <= STILL * STILL * size.at(0, y, x);
            *v = if is_still || !denoised[x].is_finite() { own[x] } else { denoised[x] * exposure };
        }
    })
}

/// Puts what both halves say where they agree on far more light than the picture has: a lamp of one pixel, say, that a
/// denoiser or a window spreads. (Less light is no such sign: where no sample hit, halves agree on 0.)
fn keep_certain(picture: &mut Image, noisy: &[Image; 2], weights: HalfWeights) {
    // The pixel's own noise may be small by chance, that around it large by its fireflies.
    let own_noise = noise(noisy, weights);
    let around = box_mean(&own_noise, NOISE_RADIUS);
    picture.for_each_row(|c, y, row| {
        let halves = noisy[0].row(c, y).iter().zip(noisy[1].row(c, y));
        let noise = own_noise.row(0, y).iter().zip(around.row(0, y));
        for ((v, (a, b)), (own_noise, around)) in row.iter_mut().zip(halves).zip(noise) {
            let own = weights.mean(*a, *b);
            let more = own.signum() * (own - *v);
            if more > 0.0 && more * more > CERTAIN * CERTAIN * own_noise.max(*around) {
                *v = own;
            }
        }
    });
}

/// How wrong a pass may be, `[1, H, W]`: in proportion to its value, and less where it is little noisier than [`LITTLE_NOISE`].
fn doubt(picture: &Image, noisy: &[Image; 2], weights: HalfWeights) -> Image {
    let square = mean_square(picture);
    let (noise, size) = (box_mean(&noise(noisy, weights), NOISE_RADIUS), box_mean(&square, NOISE_RADIUS));
    Image::from_rows(1, picture.height(), picture.width(), |_, y, row| {
        for (x, v) in row.iter_mut().enumerate() {
            let relative = (noise.at(0, y, x) / size.at(0, y, x).max(f32::MIN_POSITIVE)).sqrt();
            // Noise without any value is no less noisy than all noise.
            let share = if relative.is_finite() { relative / (relative + LITTLE_NOISE) } else { 1.0 };
            *v = square.at(0, y, x).sqrt() * share;
        }
    })
}

/// Squared noise of the mean of both halves, a value of one channel.
fn noise(noisy: &[Image; 2], weights: HalfWeights) -> Image {
    let of_mean = weights.product().sqrt();
    let difference = Image::from_rows(noisy[0].channels(), noisy[0].height(), noisy[0].width(), |c, y, row| {
        for ((v, a), b) in row.iter_mut().zip(noisy[0].row(c, y)).zip(noisy[1].row(c, y)) {
            *v = of_mean * (a - b);
        }
    });
    mean_square(&difference)
}

fn mean_square(image: &Image) -> Image {
    Image::from_rows(1, image.height(), image.width(), |_, y, row| {
        for c in 0..image.channels() {
            row.iter_mut().zip(image.row(c, y)).for_each(|(v, value)| *v += value * value / image.channels() as f32);
        }
    })
}

/// 1 / (mean² + ε) of a pass, 0 where it is missing.
fn weight(whole: &[Image; 2], valid: &Image, weights: HalfWeights) -> Image {
    let channels = whole[0].channels();
    let smooth = box_mean(&weights.mean_of(&whole[0], &whole[1]), JUDGE_RADIUS);
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
    Image::from_rows(1, weight.height(), weight.width(), |_, y, row| {
        for c in 0..noisy[0].channels() {
            for (picture, noisy) in [(&picture[0], &noisy[1]), (&picture[1], &noisy[0])] {
                for ((v, picture), noisy) in row.iter_mut().zip(picture.row(c, y)).zip(noisy.row(c, y)) {
                    *v += (picture - noisy).powi(2);
                }
            }
        }
        for (v, weight) in row.iter_mut().zip(weight.row(0, y)) {
            *v = if *weight > 0.0 { *v * weight } else { 0.0 };
        }
    })
}

fn judged(error: Image) -> Image {
    box_mean(&box_mean(&error, JUDGE_RADIUS), JUDGE_RADIUS)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A lamp of 50 in one pixel, in both halves; the picture has 10 of it. Beside it a firefly of one half, and light
    /// that no sample hit.
    #[test]
    fn a_lamp_that_both_halves_see_is_kept_and_a_firefly_is_not() {
        let half = |h: usize| {
            Image::from_fn(3, 9, 20, |_, y, x| match (y, x) {
                (4, 4) => 50.0 + 0.1 * h as f32,
                (4, 15) => 50.0 * h as f32,
                _ => 0.0,
            })
        };
        let mut picture = Image::filled(3, 9, 20, 0.2);
        picture.set(0, 4, 4, 10.0);
        keep_certain(&mut picture, &[half(0), half(1)], HalfWeights::EQUAL);
        assert_eq!([0, 1, 2].map(|c| picture.at(c, 4, 4)), [50.05; 3]);
        assert_eq!(picture.at(0, 4, 15), 0.2);
        assert_eq!(picture.at(0, 0, 0), 0.2);
    }
}
