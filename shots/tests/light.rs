//! Same light against a naive f64 twin, and what it is there for.

use sspc_image::Image;
use sspc_shots::light::{brightness, flicker, keep_same};

/// Rounding of some dozens of f32 operations, where a difference of squares loses digits.
const TOLERANCE: f64 = 2e-4;

fn random(channels: usize, height: usize, width: usize, low: f32, high: f32) -> Image {
    Image::from_fn(channels, height, width, |_, _, _| low + (high - low) * fastrand::f32())
}

fn mean_around(
    image: &dyn Fn(usize, usize) -> f64,
    (height, width): (usize, usize),
    radius: usize,
    y: usize,
    x: usize,
) -> f64 {
    let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
    let columns = x.saturating_sub(radius)..(x + radius + 1).min(width);
    let count = (rows.len() * columns.len()) as f64;
    rows.flat_map(|y| columns.clone().map(move |x| (y, x))).map(|(y, x)| image(y, x)).sum::<f64>() / count
}

/// ℓ of a pixel, by the definition.
fn twin_brightness(z: &Image, y: usize, x: usize) -> f64 {
    let mean = |y: usize, x: usize| (0..3).map(|c| f64::from(z.at(c, y, x))).sum::<f64>() / 3.0;
    mean_around(&mean, (z.height(), z.width()), 1, y, x)
}

fn bilinear(image: &dyn Fn(usize, usize) -> f64, (height, width): (usize, usize), x: f64, y: f64) -> Option<f64> {
    if !(x >= 0.0 && y >= 0.0 && x <= (width - 1) as f64 && y <= (height - 1) as f64) {
        return None;
    }
    let (left, top) = (x.floor() as usize, y.floor() as usize);
    let mut sum = 0.0;
    for (row, column) in [(top, left), (top, left + 1), (top + 1, left), (top + 1, left + 1)] {
        let weight = (1.0 - (x - column as f64).abs()) * (1.0 - (y - row as f64).abs());
        if weight > 0.0 {
            sum += weight * image(row, column);
        }
    }
    Some(sum)
}

#[test]
fn what_stays_is_what_the_definition_leaves() {
    fastrand::seed(5);
    for size @ (height, width) in [(1, 1), (1, 7), (5, 1), (9, 13), (23, 31)] {
        let z = || random(3, height, width, 0.0, 2.0);
        let own = z();
        // Little flicker, so that something is left to be said.
        let like = |picture: &Image| {
            let noise = random(3, height, width, 0.9, 1.1);
            Image::from_fn(3, height, width, |c, y, x| picture.at(c, y, x) * noise.at(c, y, x))
        };
        let other = z();
        let (frames, others) = ([own.clone(), like(&own)], [other.clone(), like(&other)]);
        let field = random(2, height, width, -2.0, 2.0);
        let phi2 = flicker(brightness(&others[0]), &brightness(&others[1]));
        for half in 0..2 {
            let mut found = Image::filled(1, height, width, 0.5);
            let [own, other] = [&frames, &others].map(|frame| brightness(&frame[half]));
            keep_same(&own, &other, &phi2, &field, &mut found);
            let ell = |y: usize, x: usize| twin_brightness(&others[half], y, x);
            let squared =
                |y: usize, x: usize| (twin_brightness(&others[0], y, x) - twin_brightness(&others[1], y, x)).powi(2);
            let flicker = |y: usize, x: usize| mean_around(&squared, size, 4, y, x);
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let place = (f64::from(x as f32 + field.at(0, y, x)), f64::from(y as f32 + field.at(1, y, x)));
                let p = twin_brightness(&frames[half], y, x);
                let expected =
                    match bilinear(&ell, size, place.0, place.1).zip(bilinear(&flicker, size, place.0, place.1)) {
                        Some((q, phi2)) => {
                            let d = ((p - q).powi(2) - 4.0 * phi2).max(0.0).sqrt() / p.max(q);
                            0.5 * ((0.5 - d) / 0.3).clamp(0.0, 1.0)
                        }
                        None => 0.5,
                    };
                let apart = (f64::from(found.at(0, y, x)) - expected).abs();
                assert!(apart <= TOLERANCE, "{height}x{width} half {half} at {y}, {x}: {apart:.1e} apart");
            }
        }
    }
}

/// What is left of validity 1 beside a neighbour whose halves are `others`.
fn left(own: f32, others: [f32; 2]) -> f32 {
    let of = |value: f32| brightness(&Image::filled(3, 8, 8, value));
    let [a, b] = others.map(of);
    let mut valid = Image::filled(1, 8, 8, 1.0);
    keep_same(&of(own), &a, &flicker(a.clone(), &b), &Image::zeros(2, 8, 8), &mut valid);
    valid.at(0, 4, 4)
}

#[test]
fn light_that_changes_counts_less_and_flicker_does_not() {
    assert_eq!(left(1.0, [1.15, 1.15]), 1.0, "a difference of 13 %");
    assert_eq!(left(1.0, [2.5, 2.5]), 0.0, "of 60 %");
    let between = left(1.0, [0.65, 0.65]);
    assert!((between - 0.5).abs() < 1e-5, "of 35 %: {between}");
    assert_eq!(left(1.0, [0.5, 0.75]), 1.0, "twice the flicker is as far as it reaches");
}

#[test]
fn exposure_is_no_light_and_what_is_unknown_says_nothing() {
    for scale in [1e-6f32, 1e6] {
        assert_eq!(left(scale, [1.15 * scale; 2]), 1.0, "{scale}");
        assert_eq!(left(scale, [2.5 * scale; 2]), 0.0, "{scale}");
    }
    assert_eq!(left(0.0, [0.0; 2]), 1.0, "black beside black");
    assert_eq!(left(0.0, [1.0; 2]), 0.0, "black beside light");
    for unknown in [f32::NAN, f32::INFINITY] {
        assert_eq!(left(1.0, [unknown; 2]), 1.0, "{unknown}");
        assert_eq!(left(unknown, [1.0; 2]), 1.0, "{unknown}");
    }
}
