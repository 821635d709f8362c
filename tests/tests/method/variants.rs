//! Several variants of z, a network for each.

use sspc_core::composition::Composition;
use sspc_core::correct::{Corrected, CorrectionSettings};
use sspc_core::prepare::{Exposure, FrameStats};
use sspc_core::rng::Rng;
use sspc_image::{DenoisedVariant, Frame, Image};
use sspc_kernels::network::WindowNetwork;
use sspc_kernels::parameters::Form;
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::frames::{frame_of, textured};
use sspc_testkit::method::{correct, random_network, settings_of};

/// Means of f32 values in another order.
const TOLERANCE: f64 = 1e-5;
const FORM: Form = Form::Gated;
const SIZE: (usize, usize) = (70, 40);

fn network(seed: u64) -> WindowNetwork {
    random_network(FORM, seed)
}

fn frame() -> Frame {
    let mut frame = frame_of(&textured(SIZE.0, SIZE.1, &mut Rng::new(5)));
    frame.denoised = Some(Image::mean_of(&frame.a.denoised, &frame.b.denoised));
    frame
}

/// A frame's own z, each picture times `factor`.
fn variant(frame: &Frame, factor: f32) -> DenoisedVariant {
    let scaled = |image: &Image| Image::from_fn(3, SIZE.0, SIZE.1, |c, y, x| factor * image.at(c, y, x));
    DenoisedVariant {
        halves: [scaled(&frame.a.denoised), scaled(&frame.b.denoised)],
        full: frame.denoised.as_ref().map(scaled),
    }
}

/// The frame with a variant in the place of z.
fn in_place_of_z(frame: &Frame, variant: &DenoisedVariant) -> Frame {
    let mut frame = frame.clone();
    [frame.a.denoised, frame.b.denoised] = variant.halves.clone();
    frame.denoised = variant.full.clone();
    frame
}

fn run(frame: &Frame, networks: &[WindowNetwork], composition: Composition, rows: usize) -> Corrected {
    let how = CorrectionSettings { rows: Some(rows), ..settings_of(FORM, 5, composition) };
    correct(frame, FrameStats::of(frame, Exposure::AsIs), networks, &how)
}

#[test]
fn the_mean_of_halves_is_the_mean_over_the_networks() {
    let frame = frame();
    let variants = [variant(&frame, 1.0), variant(&frame, 1.2), variant(&frame, 0.7)];
    let networks = [network(1), network(2), network(3)];
    let mut sum = Image::zeros(3, SIZE.0, SIZE.1);
    for (variant, network) in variants.iter().zip(&networks) {
        let one =
            run(&in_place_of_z(&frame, variant), std::slice::from_ref(network), Composition::MeanOfHalves, SIZE.0);
        sum = Image::from_fn(3, SIZE.0, SIZE.1, |c, y, x| sum.at(c, y, x) + one.picture.at(c, y, x) / 3.0);
    }
    let together = run(&Frame { variants: variants.into(), ..frame }, &networks, Composition::MeanOfHalves, SIZE.0);
    assert_images_close(&together.picture, &sum, TOLERANCE, "mean of three networks");
}

#[test]
fn variants_that_are_z_with_one_network_change_nothing() {
    let frame = frame();
    let alone = run(&frame, &[network(1)], Composition::JudgedFullBuffer, SIZE.0);
    let variants = vec![variant(&frame, 1.0), variant(&frame, 1.0)];
    let twice = run(&Frame { variants, ..frame }, &[network(1), network(1)], Composition::JudgedFullBuffer, SIZE.0);
    assert!(alone.verdict.fallback.is_none(), "a fallback would leave nothing to compare");
    assert_images_close(&twice.picture, &alone.picture, TOLERANCE, "twice the same");
}

#[test]
fn bands_of_several_variants_do_not_show() {
    let frame = frame();
    let variants = vec![variant(&frame, 1.0), variant(&frame, 1.1)];
    let frame = Frame { variants, ..frame };
    let networks = [network(1), network(2)];
    let [whole, banded] = [SIZE.0, 32].map(|rows| run(&frame, &networks, Composition::JudgedFullBuffer, rows));
    assert!(whole.verdict.fallback.is_none(), "a fallback would leave nothing to compare");
    assert_images_close(&banded.picture, &whole.picture, TOLERANCE, "in bands");
}

#[test]
fn still_blocks_stay_z_bit_for_bit_whatever_the_variants_are() {
    let mut frame = frame();
    // No noise on the left.
    for (c, y, x) in (0..3).flat_map(|c| (0..SIZE.0).flat_map(move |y| (0..16).map(move |x| (c, y, x)))) {
        let value = frame.a.radiance.at(c, y, x);
        frame.b.radiance.set(c, y, x, value);
    }
    let denoised = frame.denoised.clone().expect("z of the full buffer");
    let variants = vec![variant(&frame, 1.0), variant(&frame, 3.0)];
    let corrected = run(&Frame { variants, ..frame }, &[network(1), network(2)], Composition::JudgedFullBuffer, SIZE.0);
    let still = |image: &Image| image.crop(0, 0, SIZE.0, 16);
    assert_eq!(still(&corrected.picture).data(), still(&denoised).data());
    assert_ne!(corrected.picture.data(), denoised.data(), "something was corrected");
}

#[test]
fn a_variant_without_a_value_takes_that_of_z() {
    let frame = frame();
    let mut holed = variant(&frame, 1.0);
    holed.halves[0].set(1, 20, 20, f32::NAN);
    holed.full.as_mut().expect("full").set(0, 30, 21, f32::INFINITY);
    let [whole, holed] = [variant(&frame, 1.0), holed].map(|second| {
        let variants = vec![variant(&frame, 1.0), second];
        let frame = Frame { variants, ..frame.clone() };
        run(&frame, &[network(1), network(2)], Composition::JudgedFullBuffer, SIZE.0)
    });
    assert_eq!(holed.picture.data(), whole.picture.data());
}
