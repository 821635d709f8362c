//! Halves of different samples: means of both are weighted, wherever the method takes one.

use sspc_core::composition::Composition;
use sspc_core::correct::{Corrected, CorrectionSettings};
use sspc_core::prepare::{Exposure, FrameStats, Guides, Prepared};
use sspc_core::rng::Rng;
use sspc_image::{Frame, HalfWeights, Image};
use sspc_kernels::features::{ALBEDO, DENOISED, RADIANCE};
use sspc_kernels::parameters::Form;
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::frames::{frame_of, textured};
use sspc_testkit::method::{correct, random_network, settings_of};

/// Sums of f32 values in another order.
const TOLERANCE: f64 = 2e-5;
const FORM: Form = Form::Gated;
const SIZES: [(usize, usize); 3] = [(37, 53), (70, 41), (17, 90)];

fn frame(seed: u64, (height, width): (usize, usize), samples: [f64; 2]) -> Frame {
    let mut frame = frame_of(&textured(height, width, &mut Rng::new(seed)));
    frame.weights = HalfWeights::of_samples(samples);
    frame
}

fn run(frame: &Frame, composition: Composition) -> Corrected {
    let how = CorrectionSettings { rows: Some(32), ..settings_of(FORM, 5, composition) };
    correct(frame, FrameStats::of(frame, Exposure::AsIs), &random_network(FORM, 3), &how)
}

fn swapped(frame: &Frame, samples: [f64; 2]) -> Frame {
    let Frame { a, b, .. } = frame.clone();
    Frame { a: b, b: a, weights: HalfWeights::of_samples([samples[1], samples[0]]), ..frame.clone() }
}

#[test]
fn guides_of_the_full_buffer_are_the_halves_weighted_mean() {
    for (seed, size) in SIZES.into_iter().enumerate() {
        let samples = [1.0 + 31.0 * seed as f64, 8.0];
        let frame = frame(seed as u64, size, samples);
        let prepared = Prepared::by_stats(&frame, &FrameStats::of(&frame, Exposure::AsIs));
        let share = (samples[0] / (samples[0] + samples[1])) as f32;
        let mut row = vec![0.0; size.1];
        for (c, y, h) in (ALBEDO..DENOISED + 3).flat_map(|c| (0..size.0).map(move |y| (c, y, y % 2))) {
            prepared.features(h, Guides::Full, c, y, 0..prepared.width(), &mut row);
            let [a, b] = [0, 1].map(|h| prepared.halves[h].row(c, y));
            for x in 0..size.1 {
                let expected = share * a[x] + (1.0 - share) * b[x];
                assert!((row[x] - expected).abs() <= 1e-6 * (1.0 + expected.abs()), "{c} {y} {x}");
            }
            prepared.features(h, Guides::Full, RADIANCE, y, 0..prepared.width(), &mut row);
            assert_eq!(row, prepared.halves[h].row(RADIANCE, y));
        }
    }
}

/// With features alike in both halves, what is left of either half's g_c depends on no weights.
#[test]
fn the_picture_is_the_weighted_mean_of_the_halves_corrections() {
    for (seed, size) in SIZES.into_iter().enumerate() {
        let picture = |samples| run(&frame(seed as u64, size, samples), Composition::MeanOfHalves).picture;
        // All but all of the samples in one half.
        let alone = [[1.0, 1e-30], [1e-30, 1.0]].map(picture);
        let expected = HalfWeights::of_samples([32.0, 8.0]).mean_of(&alone[0], &alone[1]);
        assert_images_close(&picture([32.0, 8.0]), &expected, TOLERANCE, "weighted mean");
    }
}

#[test]
fn halves_may_change_places_with_their_samples() {
    let samples = [32.0, 8.0];
    for (seed, size) in SIZES.into_iter().enumerate() {
        let mut frame = frame(seed as u64, size, samples);
        let mut firefly = |c| frame.b.denoised.set(c, 9, 11, 40.0);
        (0..3).for_each(&mut firefly);
        for composition in [Composition::MeanOfHalves, Composition::JudgedFullBuffer] {
            let (one, other) = (run(&frame, composition), run(&swapped(&frame, samples), composition));
            assert_images_close(&one.picture, &other.picture, TOLERANCE, "halves swapped");
            let [p, q] = [&one, &other].map(|of| of.verdict.estimate.corrected.value);
            assert!((p - q).abs() <= 1e-4 * p.abs().max(q.abs()), "{p} {q}");
            let equal = run(&Frame { weights: HalfWeights::EQUAL, ..frame.clone() }, composition);
            assert_ne!(one.picture.data(), equal.picture.data());
        }
    }
}

/// The baseline, where nobody gives the full buffer's denoised picture.
#[test]
fn a_picture_of_which_nothing_is_corrected_is_the_weighted_mean() {
    let mut frame = frame(7, SIZES[0], [3.0, 1.0]);
    frame.b.radiance = frame.a.radiance.clone();
    let expected = Image::from_fn(3, SIZES[0].0, SIZES[0].1, |c, y, x| {
        0.75 * frame.a.denoised.at(c, y, x) + 0.25 * frame.b.denoised.at(c, y, x)
    });
    assert_eq!(run(&frame, Composition::JudgedFullBuffer).picture.data(), expected.data());
}
