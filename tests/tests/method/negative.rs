//! Noisy radiance below 0, as filters with negative lobes make it.

use sspc_core::composition::Composition;
use sspc_core::prepare::{Exposure, FrameStats, Prepared};
use sspc_core::rng::Rng;
use sspc_image::{Frame, Image};
use sspc_kernels::features::{DENOISED, RADIANCE};
use sspc_kernels::parameters::Form;
use sspc_testkit::frames::{frame_of, textured};
use sspc_testkit::method::{correct, random_network, settings_of};

const SIZE: (usize, usize) = (48, 64);
const TRUTH: f32 = 0.2;

/// Around one grey, y from -0.8 to 1.2, z from -0.05 to 0.45.
fn frame() -> Frame {
    let mut frame = frame_of(&textured(SIZE.0, SIZE.1, &mut Rng::new(5)));
    let rng = &mut Rng::new(6);
    let mut around = |width: f32| {
        Image::from_planes(
            1,
            3 * SIZE.0,
            SIZE.1,
            (0..3 * SIZE.0 * SIZE.1).map(|_| TRUTH + width * (rng.uniform() - 0.5)).collect(),
        )
    };
    for half in [&mut frame.a, &mut frame.b] {
        for (image, width) in [(&mut half.radiance, 2.0), (&mut half.denoised, 0.5)] {
            image.data_mut().copy_from_slice(around(width).data());
        }
    }
    frame.denoised = None;
    frame
}

#[test]
fn negative_radiance_stays_and_a_negative_denoised_value_is_0() {
    let frame = frame();
    let prepared = Prepared::by_stats(&frame, &FrameStats::of(&frame, Exposure::AsIs));
    for (half, given) in prepared.halves.iter().zip([&frame.a, &frame.b]) {
        for k in 0..3 {
            assert_eq!(half.plane(RADIANCE + k), given.radiance.plane(k));
            assert!(half.plane(DENOISED + k).iter().zip(given.denoised.plane(k)).all(|(z, v)| *z == v.max(0.0)));
        }
    }
    assert!(frame.a.radiance.data().iter().any(|y| *y < 0.0) && frame.a.denoised.data().iter().any(|z| *z < 0.0));
}

/// Cut off at 0, the mean of y would be 0.32.
#[test]
fn means_over_negative_radiance_are_not_too_bright() {
    let how = settings_of(Form::Paper, 9, Composition::MeanOfHalves);
    let frame = frame();
    let picture =
        correct(&frame, FrameStats::of(&frame, Exposure::AsIs), &random_network(Form::Paper, 3), &how).picture;
    let mean = picture.data().iter().sum::<f32>() / picture.data().len() as f32;
    assert!((mean - TRUTH).abs() < 0.03, "{mean}");
}
