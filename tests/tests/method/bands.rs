//! A picture finished in bands is the picture finished whole.

use sspc_core::corrector::parameters;
use sspc_core::estimate::BLOCK;
use sspc_core::finish::{Composition, Finish, Tally, finish, margin};
use sspc_core::prepare::{Exposure, FrameStats, Prepared};
use sspc_core::rng::Rng;
use sspc_image::{Frame, HalfBuffer, Image};
use sspc_kernels::gc::Taps;
use sspc_kernels::network::{Network, Shape};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;

/// A frame of noise around a gradient, with one missing pixel.
fn frame(height: usize, width: usize) -> Frame {
    let mut rng = Rng::new(5);
    let mut noise = |c, level: f32| {
        Image::from_fn(c, height, width, |c, y, x| {
            0.3 + (c + y) as f32 / 90.0 + x as f32 / 70.0 + level * rng.uniform() as f32
        })
    };
    let mut half = || HalfBuffer {
        radiance: noise(3, 1.0),
        denoised: noise(3, 0.2),
        albedo: Some(noise(3, 0.1)),
        normal: Some(noise(3, 0.1)),
        visibility: None,
    };
    let mut a = half();
    a.radiance.set(1, 40, 7, f32::NAN);
    Frame { a, b: half(), denoised: Some(noise(3, 0.1)), sources: Vec::new(), warnings: Vec::new() }
}

#[test]
fn bands_give_the_same_picture_and_the_same_figures() {
    let (height, width) = (150, 21);
    let frame = frame(height, width);
    let (isa, form, taps) = (Isa::best(), Form::Gated, Taps::square(9));
    let shape = Shape { hidden: 4, layers: 2, outputs: form.parameters() };
    let mut rng = Rng::new(2);
    let weights = (0..shape.parameter_count()).map(|_| rng.uniform() as f32 * 0.4 - 0.2).collect();
    let network = Network { shape, weights };
    let planes = |p: &Prepared| [0, 1].map(|h| parameters(isa, form, &network, &p.halves[h], &p.plan));

    for composition in [Composition::MeanOfHalves, Composition::JudgedFullBuffer] {
        let whole = Prepared::new(&frame, Exposure::Normalised);
        let [a, b] = planes(&whole);
        let expected = finish(isa, form, &taps, composition, &whole, [&a, &b]);

        let survey = FrameStats::of(&frame, Exposure::Normalised);
        let around = (margin(&taps, composition) + shape.radius()).next_multiple_of(BLOCK);
        let (mut tally, mut corrections) = (Tally::default(), Vec::new());
        for top in (0..height).step_by(48) {
            let bottom = (top + 48).min(height);
            let first = top.saturating_sub(around);
            let rows = frame.rows(first, (bottom + around).min(height) - first);
            let band = Prepared::by_stats(&rows, survey);
            let [a, b] = planes(&band);
            let how = Finish { isa, form, taps: &taps, composition, strength: 1.0 };
            let part = how.rows(&band, [&a, &b], top - first..bottom - first);
            tally.append(part.tally);
            corrections.push((top, part.correction));
        }
        let verdict = tally.verdict(composition);
        assert_eq!(verdict.fallback, expected.fallback);
        assert!(expected.fallback.is_none(), "a fallback would leave nothing to compare");
        // The box means add rows in another order: f64 sums of f32 values, rounded to f32.
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-5 * b.abs();
        assert!(close(verdict.loss.corrected, expected.loss.corrected));
        assert!(close(
            verdict.estimate.corrected.standard_error.unwrap(),
            expected.estimate.corrected.standard_error.unwrap()
        ));
        for (top, part) in corrections {
            for c in 0..3 {
                for y in 0..part.height() {
                    for x in 0..width {
                        let (found, whole) = (part.at(c, y, x), expected.correction.at(c, top + y, x));
                        assert!(
                            (found - whole).abs() <= 1e-5,
                            "channel {c} at ({}, {x}): {found}, not {whole}",
                            top + y
                        );
                    }
                }
            }
        }
    }
}
