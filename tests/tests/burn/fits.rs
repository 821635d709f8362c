//! Whole fits: on either backend, on any number of threads.

use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_kernels::network::{Network, Shape};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_testkit::closeness::assert_values_close;
use sspc_testkit::frames::{prepared, textured};
use sspc_train::backend::Backend;
use sspc_train::fit::{Control, Limits, fit, starting_network};
use sspc_train::model::Corrector;
use sspc_train::preset::{Preset, Settings};

/// Both backends take our gradient; their Adam rounds differently, and 20 steps add up.
const BACKEND_TOLERANCE: f64 = 1e-3;
/// Every loss, likewise.
const LOSS_TOLERANCE: f64 = 1e-4;

fn fitted(backend: Backend, threads: usize, seed: u64) -> (Vec<f32>, Vec<f64>) {
    let settings = Settings { tile: 16, batch: 4, ..Settings::of(Preset::Balanced, seed) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let frame = prepared(textured(40, 37, &mut Rng::new(7)));
        let limits = Limits { steps: Some(20), time: None };
        let start = starting_network(&settings);
        let fit = fit(&[&frame], &settings, start, &limits, backend, Isa::best(), |_| Control::Continue);
        (fit.network.weights, fit.history.iter().map(|s| s.loss).collect())
    })
}

#[test]
fn backends_fit_alike() {
    let (flex, losses) = fitted(Backend::Flex, 2, 1);
    let (ndarray, other) = fitted(Backend::Ndarray, 2, 1);
    assert_values_close("weights", &flex, &ndarray, BACKEND_TOLERANCE);
    let close = losses.iter().zip(&other).all(|(a, b)| (a - b).abs() <= LOSS_TOLERANCE * a);
    assert!(close, "losses differ: {losses:?} {other:?}");
    assert!(losses[19] < losses[0], "training does not lower the loss: {losses:?}");
}

#[test]
fn a_seed_gives_the_same_bits_for_any_number_of_threads() {
    let one = fitted(Backend::Flex, 1, 5);
    assert_eq!(one, fitted(Backend::Flex, 2, 5));
    assert_eq!(one, fitted(Backend::Flex, 4, 5));
    assert_ne!(one.0, fitted(Backend::Flex, 1, 6).0, "the seed has no effect");
}

#[test]
fn a_model_keeps_its_weights_in_order() {
    let network: Network = start::analytic(Shape::paper(Form::Paper), 0.6, &mut Rng::new(3));
    assert_eq!(Corrector::new(&network, Backend::Flex).to_vec(), network.weights);
}
