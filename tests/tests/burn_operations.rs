//! Our Burn operations against Burn's own arithmetic, on every backend.

use burn::tensor::{Device, Tensor, TensorData};
use sspc_core::objective::{Mirror, Objective, Tile, Workspaces};
use sspc_core::plan::Plan;
use sspc_core::prepare::{Findings, Prepared};
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::Taps;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_train::backend::Backend;
use sspc_train::fit::{Control, Limits, fit, starting_network};
use sspc_train::model::{Corrector, TileBatch, to_vec};
use sspc_train::preset::{Preset, Settings};
use std::sync::Arc;

const BACKENDS: [Backend; 2] = [Backend::Flex, Backend::Ndarray];

/// Nine layers of f32 sums in another order.
const NETWORK_TOLERANCE: f32 = 1e-5;
/// The same arithmetic on either side of the loss; only the order of its sum differs.
const LOSS_TOLERANCE: f32 = 1e-5;
/// Both backends run our kernels; their Adam rounds differently, and 20 steps add up.
const BACKEND_TOLERANCE: f32 = 1e-3;

fn prepared(height: usize, width: usize) -> Prepared {
    let rng = &mut Rng::new(7);
    let half = |rng: &mut Rng| {
        Image::from_fn(FEATURE_CHANNELS, height, width, |c, y, x| {
            let truth = 0.4 + 0.3 * ((x / 5 + y / 7 + c) % 2) as f32;
            match c {
                0..3 => (truth + 0.3 * rng.normal()).max(0.0),
                10..13 => truth + 0.02 * rng.normal(),
                _ => rng.uniform(),
            }
        })
    };
    let halves = [half(rng), half(rng)];
    let denoised = Image::filled(3, height, width, 0.5);
    let plan = Plan::new(&halves, None);
    let halves = halves.map(Arc::new);
    Prepared { plan, exposure: 1.0, halves, denoised, valid: None, set: FeatureSet::ALL, found: Findings::default() }
}

fn batch(form: Form) -> (TileBatch, Vec<f32>) {
    let objective = Objective::new(&prepared(24, 31), form, Taps::square(4), FeatureSet::ALL);
    let region = Region { top: 3, left: 2, height: 13, width: 18 };
    let mirror = |half| Mirror { rows: half == 1, columns: true, diagonal: false };
    let tiles = (0..2).map(|half| Tile { half, region, mirror: mirror(half) }).collect();
    let shape = Shape::paper(form);
    let weights = start::analytic(shape, 0.6, &mut Rng::new(3)).weights;
    (TileBatch { objective: Arc::new(objective), tiles: Arc::new(tiles), shape, isa: Isa::best() }, weights)
}

fn leaf(values: &[f32], device: &Device) -> Tensor<1> {
    Tensor::from_data(TensorData::new(values.to_vec(), [values.len()]), device).require_grad()
}

fn assert_close(what: &str, got: &[f32], truth: &[f32], tolerance: f32) {
    assert_eq!(got.len(), truth.len(), "{what}: lengths");
    let scale = truth.iter().fold(1e-20f32, |m, v| m.max(v.abs()));
    let worst = got.iter().zip(truth).map(|(g, t)| (g - t).abs());
    let worst = worst.fold(0.0, |worst: f32, e| if e.is_nan() { f32::INFINITY } else { worst.max(e) });
    assert!(worst <= tolerance * scale, "{what}: worst difference {worst:e} against {scale:e}");
}

#[test]
fn the_network_operation_is_burns_convolutions() {
    let (batch, weights) = batch(Form::Gated);
    for backend in BACKENDS {
        let device = backend.device().autodiff();
        let results = [TileBatch::outputs, TileBatch::outputs_by_burn].map(|network| {
            let w = leaf(&weights, &device);
            let outputs = network(&batch, w.clone());
            let gradients = (outputs.clone() * outputs.clone()).sum().backward();
            let gradient = w.grad(&gradients).expect("the weights are tracked");
            (to_vec(outputs.inner()), to_vec(gradient))
        });
        assert_close(&format!("{backend} outputs"), &results[0].0, &results[1].0, NETWORK_TOLERANCE);
        assert_close(&format!("{backend} gradient"), &results[0].1, &results[1].1, NETWORK_TOLERANCE);
    }
}

/// The loss of Eq. 9 composed of g_c's operation and Burn's arithmetic.
fn composed_loss(batch: &TileBatch, outputs: Tensor<4>) -> Tensor<1> {
    let (height, width) = batch.size();
    let device = outputs.device();
    let gather = |plane: fn(&sspc_core::objective::HalfObjective) -> &Image, channels: usize| {
        let values: Vec<f32> = batch
            .tiles
            .iter()
            .flat_map(|t| {
                let r = t.region;
                plane(&batch.objective.halves[t.half]).crop(r.top, r.left, r.height, r.width).into_data()
            })
            .collect();
        Tensor::<4>::from_data(TensorData::new(values, [batch.tiles.len(), channels, height, width]), &device)
    };
    let error = batch.corrected(outputs) - gather(|h| &h.target, 3);
    (error.clone() * error * gather(|h| &h.weight, 1)).mean()
}

#[test]
fn the_fused_losses_are_the_loss_composed_of_g_c() {
    for form in [Form::Paper, Form::Gated] {
        let (batch, weights) = batch(form);
        let workspaces = Arc::new(Workspaces::default());
        let of_weights = |w| batch.loss_of_weights(w, f32::INFINITY, 0..0, &workspaces);
        let of_outputs = |w| batch.loss(batch.outputs(w), f32::INFINITY);
        let composed = |w| composed_loss(&batch, batch.outputs(w));
        for backend in BACKENDS {
            let device = backend.device().autodiff();
            let losses: [&dyn Fn(Tensor<1>) -> Tensor<1>; 3] = [&of_weights, &of_outputs, &composed];
            let results = losses.map(|loss| {
                let w = leaf(&weights, &device);
                let loss = loss(w.clone());
                let value = to_vec(loss.clone().inner());
                let gradient = w.grad(&loss.backward()).expect("the weights are tracked");
                (value, to_vec(gradient))
            });
            assert_eq!(results[0], results[1], "{backend} {form:?}: a tile at a time, and a layer at a time");
            assert_close(&format!("{backend} {form:?} loss"), &results[0].0, &results[2].0, LOSS_TOLERANCE);
            assert_close(&format!("{backend} {form:?} gradient"), &results[0].1, &results[2].1, LOSS_TOLERANCE);
        }
    }
}

/// A workspace that other tiles and networks have used leaves no trace.
#[test]
fn a_used_workspace_is_as_good_as_a_new_one() {
    let used = Arc::new(Workspaces::default());
    for (form, width) in [(Form::Gated, 18), (Form::Paper, 18), (Form::Gated, 11), (Form::Gated, 18)] {
        let (mut batch, weights) = batch(form);
        let tiles = batch.tiles.iter().map(|t| Tile { region: Region { width, ..t.region }, ..*t });
        batch.tiles = Arc::new(tiles.collect());
        let gradient = |workspaces: &Arc<Workspaces>| {
            let w = leaf(&weights, &Backend::Flex.device().autodiff());
            let loss = batch.loss_of_weights(w.clone(), 1.0, 0..0, workspaces);
            to_vec(w.grad(&loss.backward()).expect("the weights are tracked"))
        };
        assert_eq!(gradient(&used), gradient(&Arc::default()), "{form:?} {width}");
    }
}

#[test]
fn a_limited_influence_bends_the_gradient_of_outliers_only() {
    let (batch, weights) = batch(Form::Gated);
    let device = Backend::Flex.device().autodiff();
    let gradient = |influence: f32| {
        let w = leaf(&weights, &device);
        let loss = batch.loss(batch.outputs(w.clone()), influence);
        to_vec(w.grad(&loss.backward()).expect("the weights are tracked"))
    };
    let free = gradient(f32::INFINITY);
    assert_close("a limit far above every error", &gradient(1e6), &free, 1e-6);
    let limited = gradient(0.1);
    let norm = |v: &[f32]| v.iter().map(|x| x * x).sum::<f32>().sqrt();
    assert!(norm(&limited) < 0.5 * norm(&free), "{} is not well below {}", norm(&limited), norm(&free));
}

fn fitted(backend: Backend, threads: usize, seed: u64) -> (Vec<f32>, Vec<f64>) {
    let settings = Settings { tile: 16, batch: 4, ..Settings::of(Preset::Balanced, seed) };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    pool.install(|| {
        let frame = prepared(40, 37);
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
    assert_close("weights", &ndarray, &flex, BACKEND_TOLERANCE);
    assert!(losses.iter().zip(&other).all(|(a, b)| (a - b).abs() <= 1e-4 * a), "losses differ: {losses:?} {other:?}");
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
    let (_, weights) = batch(Form::Paper);
    let network = sspc_kernels::network::Network { shape: Shape::paper(Form::Paper), weights: weights.clone() };
    assert_eq!(Corrector::new(&network, &Backend::Flex.device().autodiff()).to_vec(), weights);
}
