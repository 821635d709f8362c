//! Estimates of pictures whose truth is known.

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
    let (variants, composite, weights) = (Vec::new(), None, HalfWeights::EQUAL);
    let differences = None;
    let prepared = Prepared {
        exposure: 1.0,
        halves,
        denoised,
        valid: None,
        set,
        variants,
        composite,
        weights,
        differences,
        plan,
        found,
    };
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

/// A picture whose rows end inside a run of pixels, and the same with missing pixels beyond: the same sums.
#[test]
fn missing_pixels_and_the_end_of_a_row_add_nothing() {
    let (prepared, z, _) = heavy_noise(5);
    let (height, width, wide) = (40, 33, 48);
    let cut = |image: &Image, width| image.crop(0, 0, height, width);
    let of_width = |width: usize| Prepared {
        halves: prepared.halves.each_ref().map(|half| std::sync::Arc::new(cut(half, width))),
        denoised: cut(&prepared.denoised, width),
        plan: Plan::everything(height, width),
        ..prepared.clone()
    };
    let (narrow, mut padded) = (of_width(width), of_width(wide));
    padded.valid = Some(Image::from_fn(1, height, wide, |_, _, x| f32::from(u8::from(x < width))));
    let rng = &mut Rng::new(8);
    let corrected = z.each_ref().map(|z| Image::from_fn(3, height, wide, |c, y, x| z.at(c, y, x) + 0.1 * rng.normal()));
    let correction = Image::from_fn(3, height, wide, |_, _, _| 0.1 * rng.normal());
    let found = sums(&padded, &corrected, &correction);
    let expected = sums(&narrow, &corrected.each_ref().map(|image| cut(image, width)), &cut(&correction, width));
    for of in [
        |sums: &FrameSums| sums.loss_denoised.mean(),
        |sums: &FrameSums| sums.loss_corrected.mean(),
        |sums: &FrameSums| sums.gain.mean(),
        |sums: &FrameSums| sums.error_denoised.mean(),
        |sums: &FrameSums| sums.error_corrected.mean(),
    ] {
        let (found, expected) = (of(&found), of(&expected));
        assert!(found == expected && found.value != 0.0, "{found:?} {expected:?}");
    }
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
