//! The same bits for any number of threads, from a fitted model to the picture. (The fit itself is held
//! to that by `burn_operations` and the command-line tests.)

use crate::frames::sample;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_infer::engine::{Engine, Kernels};
use sspc_infer::run::correct::{Options, correct};
use sspc_infer::run::report::Seconds;
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_onnx::{Contract, Model};

#[test]
fn a_model_gives_the_same_bits_for_any_number_of_threads() {
    let frame = sample(0, 0, 100, 120);
    let contract = Contract::new(Form::Gated);
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    let options = Options { rows: Some(32), ..Options::default() };
    for kernels in [Kernels::Fused(Isa::best()), Kernels::Tract] {
        let pictures = [1, 2, 4].map(|threads| {
            let model = Model::new(contract.clone(), weights.clone()).expect("a model");
            let engine = Engine::new(model, kernels, 40);
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            let run = || correct(&engine, Isa::best(), &frame, options, &mut Seconds::default(), &|| false);
            let corrected = pool.install(run).expect("a picture");
            assert_eq!(corrected.fallback, None, "a fallback would leave nothing to compare");
            corrected.picture
        });
        assert_eq!(pictures[0], pictures[1], "{kernels:?}: two threads");
        assert_eq!(pictures[0], pictures[2], "{kernels:?}: four threads");
    }
}
