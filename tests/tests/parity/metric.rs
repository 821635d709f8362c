//! relL2 with and without the reference's halves.

use sspc_image::{Image, Reference};
use sspc_metrics::rel_l2;
use sspc_testkit::case::Case;

/// Both sides sum in f64 from the same f32 images; the mean of the halves is one f32 rounding.
const RELATIVE_L2: f64 = 1e-6;

fn image(case: &Case, key: &str, scale: f32) -> Image {
    let (height, width) = case.size("image");
    let values = case.get(key, &[3, height, width]).f32();
    Image::from_planes(3, height, width, values.into_iter().map(|v| v * scale).collect())
}

#[test]
fn relative_l2_matches_with_and_without_halves() {
    for case in Case::of_kind("relative_l2") {
        let halves = [image(&case, "reference_a", 1.0), image(&case, "reference_b", 1.0)];
        let references = [
            ("relative_l2", Reference { mean: image(&case, "reference", 1.0), halves: None }),
            ("relative_l2_halves", Reference { mean: Image::mean_of(&halves[0], &halves[1]), halves: Some(halves) }),
        ];
        for (key, reference) in references {
            let expected = case.get(key, &[1]).values[0];
            let error = |scale: f32| (rel_l2(&image(&case, "image", scale), &reference).value / expected - 1.0).abs();
            println!("{} {key}: relative error {:.1e}", case.name, error(1.0));
            assert!(
                error(1.0) <= RELATIVE_L2,
                "{} {key}: expected {expected:.9e}, error {:.2e}",
                case.name,
                error(1.0)
            );
            assert!(error(1.001) > RELATIVE_L2, "{} {key}: a picture brighter by 1e-3 goes unnoticed", case.name);
        }
    }
}
