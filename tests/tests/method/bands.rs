//! A picture corrected in bands is the picture corrected whole.

use sspc_core::composition::Composition;
use sspc_core::correct::CorrectionSettings;
use sspc_core::prepare::{Exposure, FrameStats};
use sspc_kernels::parameters::Form;
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::frames::with_missing_pixel;
use sspc_testkit::method::{correct, random_network, settings_of};

/// The box means add rows in another order: f64 sums of f32 values, rounded to f32.
const TOLERANCE: f64 = 1e-5;

#[test]
fn bands_give_the_same_picture_and_the_same_figures() {
    let (height, width) = (150, 21);
    let frame = with_missing_pixel(height, width);
    let stats = FrameStats::of(&frame, Exposure::Normalised);
    let network = random_network(Form::Gated, 2);
    for composition in [Composition::MeanOfHalves, Composition::JudgedFullBuffer] {
        let run = |rows| {
            let how = CorrectionSettings { rows: Some(rows), ..settings_of(Form::Gated, 9, composition) };
            correct(&frame, stats, &network, &how)
        };
        let (whole, banded) = (run(height), run(48));
        assert_eq!(banded.verdict.fallback, whole.verdict.fallback);
        assert!(whole.verdict.fallback.is_none(), "a fallback would leave nothing to compare");
        assert_images_close(&banded.picture, &whole.picture, TOLERANCE, &format!("{composition:?} picture"));
        let [maps, expected] = [banded.maps, whole.maps].map(|maps| maps.expect("maps were asked for"));
        assert_images_close(&maps.share, &expected.share, TOLERANCE, &format!("{composition:?} share"));
        assert_images_close(&maps.halves, &expected.halves, TOLERANCE, &format!("{composition:?} halves"));
        let close = |a: f64, b: f64| (a - b).abs() <= TOLERANCE * b.abs();
        assert!(close(banded.verdict.loss.corrected, whole.verdict.loss.corrected));
        let [found, expected] = [banded.verdict, whole.verdict].map(|verdict| verdict.estimate.corrected);
        assert!(close(found.value, expected.value), "{found:?}, not {expected:?}");
        let [found, expected] = [found, expected].map(|mean| mean.standard_error.expect("many blocks"));
        assert!(close(found, expected), "standard error {found}, not {expected}");
    }
}
