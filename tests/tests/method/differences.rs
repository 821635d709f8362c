//! Differences of y: what a file holds is found out, and the objective compares those of the correction with them.

use sspc_core::bands::{FrameBands, WITHOUT_DIFFERENCES};
use sspc_core::composition::Composition;
use sspc_core::correct::{self, BandSource, CorrectionSettings};
use sspc_core::differences::Differences;
use sspc_core::frame_stats::{Exposure, FrameStats};
use sspc_core::objective::{Objective, PixelLoss, Tile};
use sspc_core::prepare::Prepared;
use sspc_core::rng::Rng;
use sspc_image::Image;
use sspc_kernels::gc::Taps;
use sspc_kernels::loss::{self, SelfSupervised};
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::frames::{prepared, textured, with_missing_pixel};
use sspc_testkit::kernels::loss_of_tiles;
use sspc_testkit::method::{random_network, settings_of};
use std::sync::Arc;

const HEIGHT: usize = 40;
const WIDTH: usize = 56;

fn scene() -> Prepared {
    prepared(textured(HEIGHT, WIDTH, &mut Rng::new(8)))
}

/// dx and dy of both halves, noise of `noise` added to those of z.
fn given(prepared: &Prepared, noise: f32) -> [[Image; 2]; 2] {
    let rng = &mut Rng::new(4);
    let z = |c: usize, y: usize, x: usize| prepared.denoised.at(c, y.min(HEIGHT - 1), x.min(WIDTH - 1));
    let mut half = || {
        [(0, 1), (1, 0)].map(|(dy, dx)| {
            Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| z(c, y + dy, x + dx) - z(c, y, x) + noise * rng.normal())
        })
    };
    [half(), half()]
}

/// As `change` makes each image of differences, by role.
fn changed(mut halves: [[Image; 2]; 2], change: impl Fn(usize, &Image) -> Image) -> [[Image; 2]; 2] {
    for half in &mut halves {
        *half = [change(0, &half[0]), change(1, &half[1])];
    }
    halves
}

#[test]
fn the_usual_differences_are_taken_silently_and_others_by_what_they_are() {
    let prepared = scene();
    let usual = given(&prepared, 0.02);
    let (taken, said) = Differences::new(&usual, &prepared, 1.0);
    let taken = taken.expect("differences");
    assert_eq!(said, Vec::<String>::new());
    // The last column has no neighbour on the right, the last row none below.
    assert_eq!((taken.known.at(0, 3, WIDTH - 1), taken.known.at(0, 3, WIDTH - 2)), (0.0, 1.0));
    assert_eq!((taken.known.at(1, HEIGHT - 1, 3), taken.known.at(1, HEIGHT - 2, 3)), (0.0, 1.0));
    assert_eq!(taken.halves[1].at(4, 7, 9), usual[1][1].at(1, 7, 9));

    let negated = changed(usual.clone(), |_, image| Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| -image.at(c, y, x)));
    // The difference to the pixel before: that of the pixel before.
    let backward = changed(usual.clone(), |role, image| {
        let (up, left) = if role == 0 { (0, 1) } else { (1, 0) };
        Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| image.at(c, y.saturating_sub(up), x.saturating_sub(left)))
    });
    let swapped = usual.clone().map(|[dx, dy]| [dy, dx]);
    for (read, words) in [
        (negated, "dx is this pixel less the one on the right: taken as such"),
        (backward, "dy is this pixel less the one above: taken as such"),
        (swapped, "dx is the pixel below less this one: taken as such"),
    ] {
        let (found, said) = Differences::new(&read, &prepared, 1.0);
        let found = found.unwrap_or_else(|| panic!("{words}: {said:?}"));
        assert!(said.iter().any(|line| line == words), "{words}: {said:?}");
        let inside = |c: usize| (1..HEIGHT - 1).flat_map(move |y| (1..WIDTH - 1).map(move |x| (c, y, x)));
        for (c, y, x) in (0..6).flat_map(inside) {
            assert_eq!(found.halves[0].at(c, y, x), taken.halves[0].at(c, y, x), "{words}: {c} {y} {x}");
        }
    }
}

#[test]
fn what_does_not_follow_the_picture_is_not_used() {
    let prepared = scene();
    let rng = &mut Rng::new(3);
    let noise = [(); 2].map(|()| [(); 2].map(|()| Image::from_fn(3, HEIGHT, WIDTH, |_, _, _| rng.normal())));
    let (found, said) = Differences::new(&noise, &prepared, 1.0);
    assert!(found.is_none() && said[0].contains("does not follow"), "{said:?}");
    let same = given(&prepared, 0.0).map(|[dx, _]| [dx.clone(), dx]);
    let (found, said) = Differences::new(&same, &prepared, 1.0);
    assert!(found.is_none() && said.iter().any(|line| line.contains("along rows")), "{said:?}");
}

#[test]
fn unknown_and_missing_pixels_take_no_part() {
    let mut prepared = scene();
    let mut valid = Image::filled(1, HEIGHT, WIDTH, 1.0);
    valid.set(0, 20, 30, 0.0);
    prepared.valid = Some(valid);
    let mut read = given(&prepared, 0.02);
    read[0][0].set(1, 5, 6, f32::NAN);
    read[1][1].set(2, 8, 9, f32::INFINITY);
    let (found, said) = Differences::new(&read, &prepared, 1.0);
    assert!(said.iter().any(|line| line.starts_with("2 values of dx and dy are NaN")), "{said:?}");
    let differences = Arc::new(found.expect("differences"));
    prepared.differences = Some(differences.clone());
    let objective = Objective::new(&prepared, Form::Gated, Taps::square(2), prepared.set).with_own_weight(&prepared);
    for half in &objective.with_differences(&prepared).halves {
        let target = half.differences.as_ref().expect("differences of the half");
        assert!(target.target.data().iter().chain(target.weight.data()).all(|v| v.is_finite()));
        for (axis, y, x) in [(0, 5, 6), (1, 8, 9), (0, 20, 30), (0, 20, 29), (1, 20, 30), (1, 19, 30)] {
            assert_eq!(target.weight.at(axis, y, x), 0.0, "{axis} {y} {x}");
        }
        assert!(target.weight.at(0, 5, 7) > 0.0 && target.weight.at(1, 5, 6) > 0.0);
    }
}

/// Fails when a gradient has the wrong sign, place or factor anywhere between μ̂ and the network's outputs, and where a
/// tile compares pixels beyond its border.
#[test]
fn the_objectives_gradient_is_that_of_its_value() {
    let mut prepared = scene();
    prepared.differences = Differences::new(&given(&prepared, 0.05), &prepared, 1.0).0.map(Arc::new);
    let objective = Objective::new(&prepared, Form::Gated, Taps::square(2), prepared.set)
        .with_own_weight(&prepared)
        .with_differences(&prepared);
    let region = Region { top: 3, left: 39, height: 7, width: 17 };
    let (rng, isa) = (&mut Rng::new(6), Isa::best());
    let outputs: Vec<f32> = (0..16 * region.pixels()).map(|_| 0.5 * rng.normal()).collect();
    let measure = PixelLoss { scale: 1.0 / 357.0, influence: f32::INFINITY };
    let tiles = [Tile::upright(1, region)];
    let (_, gradient) = loss_of_tiles(&objective, isa, &tiles, &outputs, measure);
    let plain = Objective::new(&prepared, Form::Gated, Taps::square(2), prepared.set).with_own_weight(&prepared);
    let (_, without) = loss_of_tiles(&plain, isa, &tiles, &outputs, measure);
    assert!(gradient != without, "the term has a gradient");
    // Along random directions, central differences of the value are the gradient.
    for _ in 0..8 {
        let direction: Vec<f32> = outputs.iter().map(|_| rng.normal()).collect();
        let moved = |by: f32| -> Vec<f32> { outputs.iter().zip(&direction).map(|(o, d)| o + by * d).collect() };
        let value = |by: f32| loss_of_tiles(&objective, isa, &tiles, &moved(by), measure).0;
        let found = (value(2e-3) - value(-2e-3)) / 4e-3;
        let expected: f64 = gradient.iter().zip(&direction).map(|(g, d)| f64::from(g * d)).sum();
        let size: f64 = gradient.iter().zip(&direction).map(|(g, d)| f64::from(g * d).abs()).sum();
        assert!((found - expected).abs() < 2e-3 * size, "{found} {expected} of {size}");
    }
}

/// The naive twin: one pixel, one difference at a time, in f64.
fn naive(mu: &Image, target: &Image, weight: &Image, given: &Image, of_given: &Image, m: f64) -> (f64, Vec<f64>) {
    let (height, width) = (mu.height(), mu.width());
    let mut gradient = vec![0.0; 3 * height * width];
    let (mut sum, at) = (0.0, |k: usize, y: usize, x: usize| (k * height + y) * width + x);
    let mut add = |errors: [f64; 3], w: f64, places: &[(usize, usize, f64)]| {
        let relative = w * errors.iter().map(|e| e * e).sum::<f64>();
        sum += relative;
        for &(y, x, sign) in places {
            for k in 0..3 {
                gradient[at(k, y, x)] += sign * 2.0 * w * errors[k] / (1.0 + relative / (m * m)).sqrt();
            }
        }
    };
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        let value = |image: &Image, k: usize, y: usize, x: usize| f64::from(image.at(k, y, x));
        let colour = [0, 1, 2].map(|k| value(mu, k, y, x) - value(target, k, y, x));
        add(colour, value(weight, 0, y, x), &[(y, x, 1.0)]);
        for (axis, (y1, x1)) in [(y, x + 1), (y + 1, x)].into_iter().enumerate() {
            if y1 < height && x1 < width {
                let estimate = |k: usize| value(given, 3 * axis + k, y, x);
                let error = [0, 1, 2].map(|k| value(mu, k, y1, x1) - value(mu, k, y, x) - estimate(k));
                add(error, value(of_given, axis, y, x), &[(y, x, -1.0), (y1, x1, 1.0)]);
            }
        }
    }
    (sum, gradient)
}

#[test]
fn kernels_agree_with_their_naive_twin_on_odd_sizes() {
    let rng = &mut Rng::new(12);
    for (height, width) in [(1, 1), (1, 2), (2, 1), (3, 17), (5, 33), (16, 16)] {
        let (tall, wide) = (height + 3, width + 5);
        let mut image = |channels: usize| Image::from_fn(channels, tall, wide, |_, _, _| rng.uniform());
        let [target, weight, given, of_given, mu] = [3, 1, 6, 2, 3].map(&mut image);
        let region = Region { top: 2, left: 4, height, width };
        let cut = |image: &Image| image.crop(region.top, region.left, height, width);
        let mu = cut(&mu);
        let m = 0.7;
        let (sum, expected) = naive(&mu, &cut(&target), &cut(&weight), &cut(&given), &cut(&of_given), m);
        for isa in Isa::available() {
            let mut judge = SelfSupervised {
                target: &target,
                weight: &weight,
                region,
                scale: 1.0,
                influence: m as f32,
                squares: Vec::new(),
            };
            let mut found = vec![0.0; expected.len()];
            judge.of_tile(isa, loss::Differences { target: &given, weight: &of_given }, mu.data(), &mut found);
            let squares: f64 = judge.squares.iter().sum();
            assert!((squares / sum - 1.0).abs() < 1e-6, "{height}x{width} {}: {squares}", isa.name());
            let far = found.iter().zip(&expected).map(|(f, e)| (f64::from(*f) - e).abs()).fold(0.0, f64::max);
            assert!(far < 1e-5, "{height}x{width} {}: {far}", isa.name());
        }
    }
}

/// The mean of the loss over many other halves is that against the truth, but for a constant: the least loss lies at the
/// truth. Fails when a weight depends on the noise of the difference that it weighs.
#[test]
fn weights_do_not_know_the_noise_that_they_weigh() {
    let prepared = scene();
    let base = given(&prepared, 0.05);
    let weights = |read: &[[Image; 2]; 2]| {
        let mut prepared = prepared.clone();
        prepared.differences = Differences::new(read, &prepared, 1.0).0.map(Arc::new);
        let objective = Objective::new(&prepared, Form::Gated, Taps::square(2), prepared.set);
        objective.with_differences(&prepared).halves[0].differences.clone().expect("differences").weight
    };
    let mut moved = base.clone();
    moved[1][0].set(0, 12, 13, 50.0);
    let (before, after) = (weights(&base), weights(&moved));
    assert_eq!(before.at(0, 12, 13), after.at(0, 12, 13), "its own noise");
    assert!(after.at(0, 12, 14) < 0.1 * before.at(0, 12, 14), "its neighbour's");
    assert_eq!(before.at(1, 12, 14), after.at(1, 12, 14), "the other axis");
}

/// Fails when a band lacks a row that a difference, its weight or what reads them depends on, and where bands are looked over
/// otherwise than the whole.
#[test]
fn bands_with_differences_give_the_same_picture_and_the_same_figures() {
    let (height, width) = (150, 21);
    let mut frame = with_missing_pixel(height, width);
    let z = frame.denoised.clone().expect("a denoised picture");
    let rng = &mut Rng::new(9);
    // The pixel before is subtracted from this one: rows of a band need those above as well.
    let mut half = || {
        [(0, 1), (1, 0)].map(|(up, left)| {
            Image::from_fn(3, height, width, |c, y, x| {
                z.at(c, y, x) - z.at(c, y.saturating_sub(up), x.saturating_sub(left)) + 0.05 * rng.normal()
            })
        })
    };
    frame.differences = Some([half(), half()]);
    let stats = FrameStats::of(&frame, Exposure::Normalised);
    let network = random_network(Form::Gated, 2);
    let run = |rows: usize, strength: Option<f32>| {
        let how = CorrectionSettings { rows: Some(rows), ..settings_of(Form::Gated, 9, Composition::JudgedFullBuffer) };
        let bands = FrameBands::new(&frame, stats, true);
        let (mut bands, said) = match strength {
            Some(strength) => bands.with_differences(strength).expect("rows"),
            None => (bands, Vec::new()),
        };
        (correct::correct(&mut bands, &network, &how, &|| false).expect("a picture"), said)
    };
    let (whole, said) = run(height, Some(1.0));
    assert!(said.iter().any(|line| line == "dx is this pixel less the one on the left: taken as such"), "{said:?}");
    assert!(
        whole.verdict.fallback.is_none(),
        "a fallback would leave nothing to compare: {:?}",
        whole.verdict.fallback
    );
    let expected = whole.maps.expect("maps").share;
    let without = run(height, None).0.maps.expect("maps").share;
    assert!(without != expected, "differences take part");
    for rows in [16, 48] {
        let (banded, also_said) = run(rows, Some(1.0));
        assert_eq!(also_said, said);
        assert_images_close(&banded.picture, &whole.picture, 1e-5, &format!("bands of {rows}, picture"));
        assert_images_close(&banded.maps.expect("maps").share, &expected, 1e-5, &format!("bands of {rows}, share"));
    }
}

#[test]
fn a_frame_without_differences_is_said_and_judged_by_its_colours() {
    let frame = with_missing_pixel(40, 30);
    let bands = FrameBands::new(&frame, FrameStats::of(&frame, Exposure::Normalised), true);
    let (bands, said) = bands.with_differences(1.0).expect("rows");
    assert_eq!(said, [WITHOUT_DIFFERENCES]);
    assert!(!bands.has_differences());
}
