//! Warp, validity and mean against naive f64 twins, on odd sizes, at borders and with NaN.

use sspc_image::Image;
use sspc_shots::field::composed;
use sspc_shots::mean::TemporalMean;
use sspc_shots::validity::{Guides, validity};
use sspc_shots::warp::{Kernel, warped};

/// Rounding of some dozens of f32 operations on values up to 10.
const TOLERANCE: f64 = 2e-5;
const SIZES: [(usize, usize); 6] = [(1, 1), (1, 7), (5, 1), (2, 3), (9, 13), (17, 31)];

fn random(channels: usize, height: usize, width: usize, low: f32, high: f32) -> Image {
    Image::from_fn(channels, height, width, |_, _, _| low + (high - low) * fastrand::f32())
}

fn at(image: &Image, c: usize, y: i64, x: i64) -> f64 {
    let clamp = |v: i64, size: usize| v.clamp(0, size as i64 - 1) as usize;
    f64::from(image.at(c, clamp(y, image.height()), clamp(x, image.width())))
}

/// The definition, tap by tap: a cubic with a = -1/2 for Catmull-Rom, a tent for bilinear.
fn sample(image: &Image, c: usize, (x, y): (f64, f64), kernel: Kernel) -> Option<f64> {
    let inside = x >= 0.0 && y >= 0.0 && x <= (image.width() - 1) as f64 && y <= (image.height() - 1) as f64;
    if !inside {
        return None;
    }
    let weight = |distance: f64| {
        let d = distance.abs();
        match kernel {
            Kernel::Bilinear => (1.0 - d).max(0.0),
            Kernel::CatmullRom if d < 1.0 => 1.5 * d.powi(3) - 2.5 * d.powi(2) + 1.0,
            Kernel::CatmullRom if d < 2.0 => -0.5 * d.powi(3) + 2.5 * d.powi(2) - 4.0 * d + 2.0,
            Kernel::CatmullRom => 0.0,
        }
    };
    let (left, top) = (x.floor() as i64, y.floor() as i64);
    let mut sum = 0.0;
    for row in top - 1..top + 3 {
        for column in left - 1..left + 3 {
            let w = weight(x - column as f64) * weight(y - row as f64);
            if w != 0.0 {
                sum += w * at(image, c, row, column);
            }
        }
    }
    Some(sum)
}

fn place(field: &Image, y: usize, x: usize) -> (f64, f64) {
    // The sum is made in f32, as the definition of the field is.
    (f64::from(x as f32 + field.at(0, y, x)), f64::from(y as f32 + field.at(1, y, x)))
}

#[test]
fn warps_are_those_of_the_definition() {
    fastrand::seed(3);
    for (height, width) in SIZES {
        for kernel in [Kernel::Bilinear, Kernel::CatmullRom] {
            let image = random(2, height, width, -1.0, 9.0);
            let mut field = random(2, height, width, -3.0, 3.0);
            // Whole pixels, the borders themselves, and no place at all.
            field.data_mut().iter_mut().step_by(5).for_each(|d| *d = d.round());
            field.set(0, 0, 0, 0.0);
            field.set(1, 0, 0, 0.0);
            field.set(0, height - 1, width - 1, f32::NAN);
            let found = warped(&image, &field, kernel);
            for (c, y, x) in (0..2).flat_map(|c| (0..height).flat_map(move |y| (0..width).map(move |x| (c, y, x)))) {
                let expected = sample(&image, c, place(&field, y, x), kernel);
                let value = f64::from(found.at(c, y, x));
                match expected {
                    Some(expected) => {
                        assert!(
                            (value - expected).abs() <= TOLERANCE,
                            "{kernel:?} {height}x{width} at {y}, {x}: {value} {expected}"
                        )
                    }
                    None => assert!(value.is_nan(), "{kernel:?} {height}x{width} at {y}, {x}: {value} outside"),
                }
            }
        }
    }
}

#[test]
fn validity_and_mean_are_those_of_the_definition() {
    fastrand::seed(4);
    for (height, width) in SIZES {
        let feature = || random(3, height, width, -1.0, 1.0);
        let (own, mut other) = ([feature(), feature()], [feature(), feature()]);
        // A normal that is missing in the neighbour says nothing there.
        other[1].set(0, height / 2, width / 2, f32::NAN);
        let (z, mut neighbour) = (random(3, height, width, 0.0, 5.0), random(3, height, width, 0.0, 5.0));
        neighbour.set(1, height / 2, width / 2, f32::NAN);
        let field = random(2, height, width, -2.0, 2.0);
        let guides = |pair: &'static [Image; 2]| Guides { albedo: Some(&pair[0]), normal: Some(&pair[1]) };
        let (own, other): (&'static [Image; 2], &'static [Image; 2]) =
            (Box::leak(Box::new(own)), Box::leak(Box::new(other)));
        let valid = validity(&guides(own), &guides(other), &field);
        let mut mean = TemporalMean::new(1, height, width);
        mean.add(&[&neighbour], &field, &valid);
        let mean = mean.finish(&[&z]).remove(0);
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let place = place(&field, y, x);
            let distance = |k: usize, weight: f64| -> Option<f64> {
                let mut sum = 0.0;
                for c in 0..3 {
                    let apart = at(&own[k], c, y as i64, x as i64) - sample(&other[k], c, place, Kernel::Bilinear)?;
                    sum += apart * apart;
                }
                Some(if sum.is_finite() { weight * sum } else { 0.0 })
            };
            let v = distance(0, 8.0).zip(distance(1, 2.0)).map_or(0.0, |(a, n)| (-0.3 * (a + n)).exp());
            // NaN under a bilinear tap of weight 0 counts as missing in f32, and not in the twin: not drawn here.
            assert!((f64::from(valid.at(0, y, x)) - v).abs() <= TOLERANCE, "{height}x{width} at {y}, {x}");
            let warped: Vec<Option<f64>> =
                (0..3).map(|c| sample(&neighbour, c, place, Kernel::CatmullRom).filter(|v| v.is_finite())).collect();
            for c in 0..3 {
                let own = f64::from(z.at(c, y, x));
                let expected = match warped.iter().copied().collect::<Option<Vec<f64>>>() {
                    Some(all) => (own + v * all[c]) / (1.0 + v),
                    None => own,
                };
                assert!((f64::from(mean.at(c, y, x)) - expected).abs() <= TOLERANCE, "{height}x{width} at {y}, {x}");
            }
        }
    }
}

#[test]
fn without_neighbours_z_stays_bit_for_bit() {
    let z = random(3, 5, 7, 0.0, 2.0);
    assert_eq!(TemporalMean::new(1, 5, 7).finish(&[&z])[0], z);
    let mut mean = TemporalMean::new(1, 5, 7);
    let outside = Image::filled(2, 5, 7, 100.0);
    mean.add(&[&random(3, 5, 7, 0.0, 2.0)], &outside, &Image::filled(1, 5, 7, 1.0));
    assert_eq!(mean.finish(&[&z])[0], z);
}

/// Fails when `second` is read at the start instead of the end of `first`.
#[test]
fn fields_follow_each_other() {
    let first = Image::from_fn(2, 4, 9, |c, _, _| if c == 0 { 2.0 } else { 0.0 });
    let second = Image::from_fn(2, 4, 9, |c, _, x| if c == 0 { x as f32 } else { 0.25 });
    let both = composed(&first, &second);
    assert_eq!((both.at(0, 1, 3), both.at(1, 1, 3)), (2.0 + 5.0, 0.25));
    assert!(both.at(0, 1, 7).is_nan(), "column 9 is outside");
}
