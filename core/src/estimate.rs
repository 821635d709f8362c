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
    /// None below two blocks of pixels: a variance needs two.
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
/// reference's own denominator 0 to 0.15 are, over eleven frames and three presets.)
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
mod tests {
    use super::*;
    use crate::frame_sums::FrameSums;
    use crate::plan::Plan;
    use crate::prepare::Findings;
    use crate::rng::Rng;
    use sspc_image::HalfWeights;
    use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet, RADIANCE};

    /// Share of a half's noise that its z keeps.
    const KEPT: f32 = 0.3;
    /// A z that follows so heavy a noise also weighs its own errors, by some half of them.
    const WITHIN: f64 = 2.0;
    const TRUTH: f32 = 0.5;
    /// Three standard errors (0.045) of the estimate over the true error with the true denominator.
    const BY_CHANCE: f64 = 0.14;

    fn rel_l2(picture: &Image) -> f64 {
        let squared = picture.data().iter().map(|v| f64::from(v - TRUTH).powi(2)).sum::<f64>();
        squared / picture.data().len() as f64 / f64::from(TRUTH * TRUTH + RELATIVE_FLOOR)
    }

    /// Denoised halves that follow exponential noise around one grey, and the true relL2 of their mean.
    fn heavy_noise(seed: u64) -> (Prepared, [Image; 2], f64) {
        let rng = &mut Rng::new(seed);
        let (height, width) = (192, 256);
        let mut halves = [0, 1].map(|_| Image::zeros(FEATURE_CHANNELS, height, width));
        for half in &mut halves {
            for i in 0..height * width {
                let y = -TRUTH * (1.0 - rng.uniform()).max(1e-7).ln();
                for k in 0..3 {
                    half.plane_mut(RADIANCE + k)[i] = y;
                    half.plane_mut(DENOISED + k)[i] = TRUTH + KEPT * (y - TRUTH);
                }
            }
        }
        let z = [0, 1].map(|h| crate::objective::triple(&halves[h], DENOISED));
        let denoised = Image::mean_of(&z[0], &z[1]);
        let expected = rel_l2(&denoised);
        let plan = Plan::everything(height, width);
        let halves = halves.map(std::sync::Arc::new);
        let (set, found) = (FeatureSet::NONE, Findings::default());
        let (variants, weights) = (Vec::new(), HalfWeights::EQUAL);
        let differences = None;
        let prepared =
            Prepared { exposure: 1.0, halves, denoised, valid: None, set, variants, weights, differences, plan, found };
        (prepared, z, expected)
    }

    /// Half a of 4 samples, half b of 1: exponential noise each, and z that keeps a share of it.
    fn unequal(rng: &mut Rng) -> (Prepared, [Image; 2], f64) {
        let (mut prepared, ..) = heavy_noise(3);
        prepared.weights = HalfWeights::of_samples([4.0, 1.0]);
        for (h, samples) in [(0, 4), (1, 1)] {
            let half = std::sync::Arc::make_mut(&mut prepared.halves[h]);
            for (k, i) in (0..3).flat_map(|k| (0..half.pixels()).map(move |i| (k, i))).collect::<Vec<_>>() {
                let mut sample = || -TRUTH * (1.0 - rng.uniform()).max(1e-7).ln();
                let y = (0..samples).map(|_| sample()).sum::<f32>() / samples as f32;
                half.plane_mut(RADIANCE + k)[i] = y;
                half.plane_mut(DENOISED + k)[i] = TRUTH + KEPT * (y - TRUTH);
            }
        }
        let z = [0, 1].map(|h| crate::objective::triple(&prepared.halves[h], DENOISED));
        prepared.denoised = prepared.weights.mean_of(&z[0], &z[1]);
        let expected = rel_l2(&prepared.denoised);
        (prepared, z, expected)
    }

    /// Equal weights would give the error of another mean, 1.6 times as large; one standard error is 0.07.
    #[test]
    fn the_estimate_of_unequal_halves_is_that_of_their_weighted_mean() {
        let rng = &mut Rng::new(4);
        let ratio = |_| {
            let (prepared, z, expected) = unequal(rng);
            let exact = Image::from_rows(3, prepared.height(), prepared.width(), |k, y, row| {
                row.iter_mut().zip(prepared.denoised.row(k, y)).for_each(|(c, z)| *c = TRUTH - z);
            });
            sums(&prepared, &z, &exact).error_corrected.mean().value / expected
        };
        let mean = (0..8).map(ratio).sum::<f64>() / 8.0;
        assert!((mean - 1.0).abs() < 0.2, "estimated over true: {mean}");
    }

    /// Sums over a picture that adds `correction`, of halves corrected wholly.
    fn sums(prepared: &Prepared, corrected: &[Image; 2], correction: &Image) -> FrameSums {
        let share = Image::filled(1, prepared.height(), prepared.width(), 1.0);
        FrameSums::of(prepared, corrected, &share, correction, 0..prepared.height())
    }

    /// Under weights of the half compared with, this estimate is -4 times the error.
    #[test]
    fn heavy_noise_that_z_follows_does_not_make_the_estimate_negative() {
        let (prepared, z, expected) = heavy_noise(3);
        let nothing = Image::zeros(3, prepared.height(), prepared.width());
        let found = sums(&prepared, &z, &nothing).error_corrected.mean();
        let ratio = found.value / expected;
        assert!((1.0 / WITHIN..WITHIN).contains(&ratio), "estimated {found:?}, true {expected}");
    }

    /// z's own errors in the denominator are worth 44 % here, and no scatter of blocks tells of them.
    #[test]
    fn a_finished_picture_near_the_truth_mends_the_estimate_and_the_standard_error_says_by_how_much() {
        let (prepared, z, expected) = heavy_noise(3);
        let exact = Image::from_rows(3, prepared.height(), prepared.width(), |k, y, row| {
            row.iter_mut().zip(prepared.denoised.row(k, y)).for_each(|(c, z)| *c = TRUTH - z);
        });
        let errors = sums(&prepared, &z, &exact).error_corrected;
        let (found, before) = (errors.mean(), errors.denoised.mean());
        let off = |mean: Mean| (mean.value / expected - 1.0).abs();
        assert!(off(found) < BY_CHANCE && off(before) > 2.0 * BY_CHANCE, "{found:?} and {before:?}, true {expected}");
        let (scatter, told) = (errors.finished.mean().standard_error.unwrap(), found.standard_error.unwrap());
        assert!(told > 2.0 * scatter && told >= (found.value - before.value).abs(), "{told}, of blocks {scatter}");
    }

    /// Halves and picture that are carried so far of the way from z to the truth, and the sums over them.
    fn carried(prepared: &Prepared, z: &[Image; 2], far: f32) -> FrameSums {
        let towards = |of: &Image, all: f32| {
            Image::from_rows(3, of.height(), of.width(), |k, y, row| {
                row.iter_mut().zip(of.row(k, y)).for_each(|(v, z)| *v = all * z + far * (TRUTH - z));
            })
        };
        sums(prepared, &z.each_ref().map(|z| towards(z, 1.0)), &towards(&prepared.denoised, 0.0))
    }

    /// z has bright blotches where y has none: its own brightness hides half of that error.
    #[test]
    fn the_step_to_the_references_denominator_mends_the_estimate() {
        const LEFT: f32 = 0.7;
        for seed in 3..8 {
            let (mut prepared, ..) = heavy_noise(seed);
            let rng = &mut Rng::new(seed);
            for half in &mut prepared.halves {
                let half = std::sync::Arc::make_mut(half);
                for i in 0..half.pixels() {
                    let z = if rng.uniform() < 0.1 { 2.0 * TRUTH } else { TRUTH };
                    (0..3).for_each(|k| half.plane_mut(DENOISED + k)[i] = z);
                    let y = TRUTH * (0.8 + 0.4 * rng.uniform());
                    (0..3).for_each(|k| half.plane_mut(RADIANCE + k)[i] = y);
                }
            }
            let z = [0, 1].map(|h| crate::objective::triple(&prepared.halves[h], DENOISED));
            prepared.denoised = Image::mean_of(&z[0], &z[1]);
            let expected = rel_l2(&prepared.denoised);
            let sums = carried(&prepared, &z, 1.0 - LEFT);
            let Estimate { denoised, corrected, gain } =
                Estimate::of(&sums.error_denoised, &sums.error_corrected, &sums.error_gain, true);
            let before = sums.error_denoised.finished.mean().value / expected;
            let found = denoised.value / expected;
            assert!((0.45..0.6).contains(&before) && found > before + 0.03 && found < 1.0, "{before} to {found}");
            assert!((denoised.value - corrected.value - gain.value).abs() < 1e-9, "{gain:?}");
        }
    }

    /// Of a picture whose error does not change over it both standard errors are alike; where it does, that of the noise
    /// does not grow.
    #[test]
    fn the_standard_error_is_that_of_the_noise() {
        let off = |seed| {
            let (prepared, z, expected) = heavy_noise(seed);
            let sums = carried(&prepared, &z, 1.0 - 1e-3);
            let errors = &sums.error_denoised;
            (errors.finished.mean().value - expected) / errors.noise().expect("blocks of many pixels")
        };
        let squares = (0..12).map(|seed| off(seed).powi(2)).sum::<f64>() / 12.0;
        assert!((0.3..3.0).contains(&squares), "mean square in standard errors: {squares}");
    }

    #[test]
    fn where_nothing_is_left_out_nothing_is_gained() {
        let (prepared, z, _) = heavy_noise(3);
        let sums = carried(&prepared, &z, 0.0);
        let nothing = sums.error_denoised.nothing();
        let same = Estimate::of(&sums.error_denoised, &sums.error_denoised, &nothing, false);
        assert_eq!((same.gain.value, same.gain.standard_error), (0.0, Some(0.0)));
        assert_eq!(same.corrected, same.denoised);
    }

    /// Under weights of the half compared with, a darker picture seems to gain: y is low where they are large.
    #[test]
    fn to_be_darker_is_no_gain() {
        let (prepared, z, _) = heavy_noise(3);
        let darker = z.each_ref().map(|z| {
            Image::from_rows(3, z.height(), z.width(), |k, y, row| {
                row.iter_mut().zip(z.row(k, y)).for_each(|(d, z)| *d = z - 0.02);
            })
        });
        let nothing = Image::zeros(3, prepared.height(), prepared.width());
        let found = sums(&prepared, &darker, &nothing).gain.mean();
        // E[w((z - μ)² - (z - 0.02 - μ)²)] with w and z of one half, known here.
        let (mut sum, mut count) = (0.0, 0.0);
        for z in z.iter().flat_map(|z| z.plane(0)) {
            let (weight, off) = (1.0 / f64::from(z * z + RELATIVE_FLOOR), f64::from(z - TRUTH));
            sum += weight * (off * off - (off - 0.02).powi(2));
            count += 1.0;
        }
        let error = found.standard_error.expect("many blocks");
        assert!(sum < 0.0 && found.value < 0.0, "{found:?}");
        assert!((found.value - sum / count).abs() < 4.0 * error, "{found:?}, expected {}", sum / count);
    }
}
