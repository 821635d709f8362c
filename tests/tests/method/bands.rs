//! A picture corrected in bands is the picture corrected whole.

use sspc_core::composition::Composition;
use sspc_core::correct::CorrectionSettings;
use sspc_core::prepare::{Exposure, FrameStats};
use sspc_core::rng::Rng;
use sspc_kernels::network::{Network, Shape};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::frames::with_missing_pixel;
use sspc_testkit::method::{correct, window_network};

/// The box means add rows in another order: f64 sums of f32 values, rounded to f32.
const TOLERANCE: f64 = 1e-5;

#[test]
fn bands_give_the_same_picture_and_the_same_figures() {
    let (height, width) = (150, 21);
    let frame = with_missing_pixel(height, width);
    let stats = FrameStats::of(&frame, Exposure::Normalised);
    let form = Form::Gated;
    let shape = Shape { hidden: 4, layers: 2, outputs: form.parameters() };
    let mut rng = Rng::new(2);
    let weights = (0..shape.parameter_count()).map(|_| rng.uniform() * 0.4 - 0.2).collect();
    let network = window_network(form, &Network { shape, weights });
    for composition in [Composition::MeanOfHalves, Composition::JudgedFullBuffer] {
        let run = |rows| {
            let isa = Isa::best();
            let how = CorrectionSettings {
                isa,
                form,
                window_radius: 9,
                composition,
                judged_by_held_out: false,
                strength: 1.0,
                rows: Some(rows),
                keep_maps: true,
            };
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
