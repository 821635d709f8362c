//! Warp, validity and temporal mean of a shot.

use sspc_image::Image;
use sspc_shots::light::{brightness, flicker, keep_same};
use sspc_shots::mean::TemporalMean;
use sspc_shots::validity::{Guides, validity};
use sspc_shots::warp::{Kernel, warped};
use sspc_testkit::case::Case;

/// Sixteen products in f32 of values up to 2, and places that are rounded to 6e-8 of a picture's width.
const WARP: f64 = 5e-6;

fn image(case: &Case, key: &str, channels: usize, (height, width): (usize, usize)) -> Image {
    Image::from_planes(channels, height, width, case.get(key, &[channels, height, width]).f32())
}

/// The largest difference where `outside` is 0.
fn apart(found: &Image, case: &Case, key: &str, outside: Option<&Image>) -> f64 {
    let expected = &case.get(key, &[found.channels(), found.height(), found.width()]).values;
    let pixels = found.pixels();
    let inside = |i: &usize| outside.is_none_or(|outside| outside.data()[i % pixels] == 0.0);
    let differences = (0..expected.len()).filter(inside).map(|i| (f64::from(found.data()[i]) - expected[i]).abs());
    // NaN is as far apart as can be.
    differences.fold(0.0, |most, apart| if apart > most || apart.is_nan() { apart } else { most })
}

#[test]
fn warp_validity_and_mean_match() {
    for case in Case::of_kind("shot") {
        for (height, width) in [(1, 1), (1, 6), (7, 1), (9, 13)] {
            let (size, text) = ((height, width), format!("{height}x{width}"));
            let get = |name: &str, channels| image(&case, &format!("{name}_{text}"), channels, size);
            let (z, albedo, normal) = (get("denoised", 3), get("albedo", 3), get("normal", 3));
            let own = Guides { albedo: Some(&albedo), normal: Some(&normal) };
            let mut mean = TemporalMean::new(1, height, width);
            for k in 0..2 {
                let of = |name: &str, channels| get(&format!("neighbour{k}_{name}"), channels);
                let (other, albedo, normal) = (of("denoised", 3), of("albedo", 3), of("normal", 3));
                let (field, outside) = (get(&format!("field{k}"), 2), get(&format!("outside{k}"), 1));
                let check = |found: &Image, name: &str, outside: Option<&Image>| {
                    let apart = apart(found, &case, &format!("{name}{k}_{text}"), outside);
                    assert!(apart <= WARP, "{} {name}{k}_{text}: {apart:.1e} apart", case.name);
                };
                check(&warped(&other, &field, Kernel::Bilinear), "bilinear", Some(&outside));
                check(&warped(&other, &field, Kernel::CatmullRom), "cubic", Some(&outside));
                let mut valid = validity(&own, &Guides { albedo: Some(&albedo), normal: Some(&normal) }, &field);
                check(&valid, "validity", None);
                let (bright, of_b) = (brightness(&other), brightness(&of("denoised_of_b", 3)));
                keep_same(&brightness(&z), &bright, &flicker(bright.clone(), &of_b), &field, &mut valid);
                check(&valid, "valid_in_same_light", None);
                mean.add(&[&other], &field, &valid);
            }
            let found = mean.finish(&[&z]).remove(0);
            let key = format!("mean_{text}");
            assert!(apart(&found, &case, &key, None) <= WARP, "{} {key}", case.name);
            // The test would notice a mean that leaves out the neighbours.
            assert!(text == "1x1" || apart(&z, &case, &key, None) > 1e-3, "{} {key}", case.name);
        }
    }
}
