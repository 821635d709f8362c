//! The same bits for any number of threads, from a fitted model to the picture. (The fit itself is held
//! to that by the test `burn` and the command-line tests.)

use crate::frames::sample;
use sspc_core::correct::CorrectionSettings;
use sspc_core::frame_stats::FrameStats;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_onnx::{Contract, Model};
use sspc_testkit::method::{correct, settings};

#[test]
fn a_model_gives_the_same_bits_for_any_number_of_threads() {
    let frame = sample(0, 0, 100, 120);
    let contract = Contract::new(Form::Gated);
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    let stats = FrameStats::of(&frame, contract.exposure);
    let how = CorrectionSettings { rows: Some(32), ..settings(&contract) };
    for kernels in [Kernels::Fused(Isa::best()), Kernels::Tract] {
        let pictures = [1, 2, 4].map(|threads| {
            let model = Model::new(contract.clone(), weights.clone()).expect("a model");
            let engine = Engine::new(model, kernels, 40);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let corrected = pool.install(|| correct(&frame, stats, &engine, &how));
            assert_eq!(corrected.verdict.fallback, None, "a fallback would leave nothing to compare");
            corrected.picture
        });
        assert_eq!(pictures[0], pictures[1], "{kernels:?}: two threads");
        assert_eq!(pictures[0], pictures[2], "{kernels:?}: four threads");
    }
}
