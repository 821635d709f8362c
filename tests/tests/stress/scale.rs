//! A scaled frame gives the scaled picture: exposure is normalised and undone.
//!
//! Powers of two change no mantissa, so they must change no bit, training included. Any other factor
//! rounds every value anew, by 6e-8; one model gives the same picture then to 1e-4, while training
//! takes such a rounding further with every step, until the two fits differ as those of two seeds do.

use crate::frames::{corrected, fitted, sample, scaled};
use sspc_core::prepare::{FrameStats, Prepared};
use sspc_image::Image;
use sspc_metrics::rel_l2;
use sspc_testkit::frames::sample_reference;
use sspc_train::fit::starting_network;
use sspc_train::preset::{Preset, Settings};

/// Of a pixel's value, or of a hundredth of the picture's mean where it is darker than that.
const TOLERANCE: f64 = 1e-4;
const DARK: f64 = 1e-2;
/// Steps for which rounding stays below the tolerance.
const FEW_STEPS: usize = 3;
/// relL2 of fits of the sample frame differs by up to this share: by 6 % between seeds, by 2 % between exposures.
const AS_TWO_SEEDS: f64 = 0.06;

const PRESETS: [Preset; 3] = [Preset::Fast, Preset::Balanced, Preset::Quality];
const DECIMAL: [f32; 4] = [1e-8, 1e-4, 1e4, 1e8];
/// 2^-27 and 2^27: 7e-9 and 1.3e8.
const BINARY: [f32; 2] = [7.450_581e-9, 134_217_728.0];

/// Largest difference of `found` / `factor` to `expected`.
fn difference(found: &Image, expected: &Image, factor: f32) -> f64 {
    let mean = expected.data().iter().map(|v| f64::from(*v)).sum::<f64>() / expected.data().len() as f64;
    let errors = found.data().iter().zip(expected.data()).map(|(f, e)| {
        let (f, e) = (f64::from(*f) / f64::from(factor), f64::from(*e));
        (f - e).abs() / e.max(DARK * mean)
    });
    errors.fold(0.0, |worst: f64, e| if e.is_nan() { f64::INFINITY } else { worst.max(e) })
}

/// The picture of a frame times `factor`, after `steps` of training.
fn picture(frame: &sspc_image::Frame, factor: f32, settings: &Settings, steps: Option<usize>) -> Image {
    let frame = scaled(frame, factor);
    let prepared = Prepared::by_stats(&frame, &FrameStats::of(&frame, settings.exposure));
    let network = match steps {
        Some(0) => starting_network(settings),
        _ => fitted(&prepared, settings, steps).network,
    };
    let done = corrected(&frame, FrameStats::of(&frame, settings.exposure), settings, &network);
    assert_eq!(done.verdict.fallback, None, "a fallback would leave nothing to compare");
    done.picture
}

#[test]
fn a_scaled_frame_gives_the_scaled_picture() {
    let frame = sample(60, 90, 64, 80);
    let mut text = String::from("\nA scaled frame's picture against the scaled picture, largest relative difference\n");
    let mut failures = Vec::new();
    for preset in PRESETS {
        let settings = Settings::of(preset, 1);
        for steps in [0, FEW_STEPS] {
            let expected = picture(&frame, 1.0, &settings, Some(steps));
            text += &format!("{:10} {steps} steps", preset.to_string());
            for factor in DECIMAL {
                let error = difference(&picture(&frame, factor, &settings, Some(steps)), &expected, factor);
                text += &format!("  {factor:.0e}: {error:.1e}");
                if error.is_nan() || error > TOLERANCE {
                    failures.push(format!("{preset}, {steps} steps, at {factor:e}: {error:e}"));
                }
            }
            text += "\n";
        }
    }
    println!("{text}");
    assert!(failures.is_empty(), "{failures:#?}");
}

#[test]
fn a_power_of_two_changes_no_bit() {
    let frame = sample(60, 90, 64, 80);
    for preset in PRESETS {
        let settings = Settings::of(preset, 1);
        // No limit of steps: what a preset takes for a picture of this size.
        let mut expected = picture(&frame, 1.0, &settings, None);
        for factor in BINARY {
            let found = picture(&frame, factor, &settings, None);
            expected.data_mut().iter_mut().for_each(|v| *v *= factor);
            assert!(found == expected, "{preset} at {factor:e}: {:e}", difference(&found, &expected, 1.0));
            expected.data_mut().iter_mut().for_each(|v| *v /= factor);
        }
    }
}

#[test]
#[ignore = "minutes: every step of two presets on the whole sample frame"]
fn fits_of_a_scaled_frame_differ_as_two_seeds_do() {
    let frame = sample(0, 0, 192, 256);
    let reference = sample_reference();
    for preset in [Preset::Fast, Preset::Balanced] {
        let rel_l2_of = |factor: f32, seed: u64| {
            let mut picture = picture(&frame, factor, &Settings::of(preset, seed), None);
            picture.data_mut().iter_mut().for_each(|v| *v /= factor);
            rel_l2(&picture, &reference).value
        };
        let scaled = [1.0, 1e-8, 1e-4, 1e4, 1e8].map(|factor| rel_l2_of(factor, 1));
        let seeds = [2, 3, 4].map(|seed| rel_l2_of(1.0, seed));
        println!("{preset}: relL2 at 1, 1e-8, 1e-4, 1e4, 1e8: {scaled:.6?}; of other seeds: {seeds:.6?}");
        for value in scaled {
            assert!((value / scaled[0] - 1.0).abs() < AS_TWO_SEEDS, "{preset}: {scaled:?}");
        }
    }
}

#[test]
fn beyond_the_range_of_exposures_pictures_stay_finite() {
    let frame = sample(60, 90, 40, 48);
    for factor in [0.0, 1e-37, 1e-20, 1e20, 1e36] {
        let frame = scaled(&frame, factor);
        for preset in [Preset::Fast, Preset::Paper] {
            let settings = Settings { tile: 24, batch: 2, ..Settings::of(preset, 1) };
            let prepared = Prepared::by_stats(&frame, &FrameStats::of(&frame, settings.exposure));
            let fit = fitted(&prepared, &settings, Some(3));
            let picture = corrected(&frame, FrameStats::of(&frame, settings.exposure), &settings, &fit.network).picture;
            assert!(fit.network.weights.iter().all(|w| w.is_finite()), "{preset} at {factor:e}: weights");
            assert!(picture.data().iter().all(|v| v.is_finite() && *v >= 0.0), "{preset} at {factor:e}: picture");
        }
    }
}
