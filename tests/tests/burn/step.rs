//! A training step of ours against the same composed of Burn's convolutions, its autodiff and g_c.

use super::BACKENDS;
use super::convolutions::Network;
use sspc_core::objective::{HalfObjective, Mirror, Objective, Step, Tile, Workspaces};
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_image::Image;
use sspc_kernels::features::FeatureSet;
use sspc_kernels::gc::Taps;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::{Form, activate_backward};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_testkit::closeness::assert_values_close;
use sspc_testkit::frames::{prepared, textured};
use sspc_testkit::kernels::{Pass, activated, correct_and_back, features_of};

/// Nine layers of f32 sums in another order.
const NETWORK_TOLERANCE: f64 = 1e-5;
/// The same arithmetic on either side of the network; only the order of its sums differs.
const LOSS_TOLERANCE: f64 = 1e-5;

/// Two mirrored tiles of a small frame, one of each half, and a network's weights.
struct Setup {
    objective: Objective,
    tiles: [Tile; 2],
    shape: Shape,
    weights: Vec<f32>,
}

impl Setup {
    fn new(form: Form) -> Self {
        let prepared = prepared(textured(24, 31, &mut Rng::new(7)));
        let objective = Objective::new(&prepared, form, Taps::square(4), FeatureSet::ALL);
        let region = Region { top: 3, left: 2, height: 13, width: 18 };
        let mirror = |half| Mirror { rows: half == 1, columns: true, diagonal: false };
        let shape = Shape::paper(form);
        let weights = start::analytic(shape, 0.6, &mut Rng::new(3)).weights;
        Self { objective, tiles: [0, 1].map(|half| Tile { half, region, mirror: mirror(half) }), shape, weights }
    }

    fn features(&self) -> Vec<f32> {
        self.tiles.iter().flat_map(|tile| features_of(&self.objective, tile)).collect()
    }

    /// Loss and gradient of our step.
    fn step(&self, influence: f32, workspaces: &Workspaces) -> (f64, Vec<f32>) {
        let (objective, shape, isa) = (&self.objective, self.shape, Isa::best());
        Step { objective, shape, isa, influence, frozen_outputs: 0..0 }.run(&self.weights, &self.tiles, workspaces)
    }

    /// The mean of Eq. 9 over the tiles, written out, and its gradient by network outputs of `tile`: through g_c, with
    /// the gradient of the loss by μ̂ known beforehand.
    fn loss_of(&self, tile: &Tile, outputs: &[f32]) -> (f64, Vec<f32>) {
        let (isa, form, region) = (Isa::best(), self.objective.form, tile.region);
        let HalfObjective { planes, target, weight, .. } = &self.objective.halves[tile.half];
        let cut = |image: &Image| image.crop(region.top, region.left, region.height, region.width);
        let (target, weight) = (cut(target), cut(weight));
        let windows = planes.windows(region, Vec::new());
        let mut upright = outputs.to_vec();
        tile.mirror.undo(&mut upright, region.height, region.width);
        let parameters = activated(isa, form, &upright);
        let back = |upstream: &[f32]| {
            let (taps, at) = (&self.objective.taps, region.at_origin());
            correct_and_back(isa, form, &windows, taps, at, &parameters, upstream)
        };
        let corrected = back(&vec![0.0; 3 * region.pixels()]).0;
        let scale = 1.0 / (3 * region.pixels() * self.tiles.len()) as f64;
        let (mut loss, mut upstream) = (0.0, Vec::new());
        for (i, (c, t)) in corrected.iter().zip(target.data()).enumerate() {
            let (error, w) = (f64::from(c - t), f64::from(weight.plane(0)[i % region.pixels()]));
            loss += scale * w * error * error;
            upstream.push((2.0 * scale * w * error) as f32);
        }
        let mut gradient = back(&upstream).1;
        tile.mirror.apply(&mut gradient, region.height, region.width);
        activate_backward(isa, form, outputs, &mut gradient);
        (loss, gradient)
    }
}

#[test]
fn our_network_is_burns_convolutions() {
    let setup = Setup::new(Form::Gated);
    let (features, region) = (setup.features(), setup.tiles[0].region);
    let tiles = features.chunks_exact(features.len() / 2);
    let (mut outputs, mut gradient) = (Vec::new(), vec![0.0; setup.weights.len()]);
    for tile in tiles {
        let pass = Pass::forward(Isa::best(), &setup.shape, &setup.weights, tile, region.height, region.width);
        let of_squares: Vec<f32> = pass.outputs.iter().map(|o| 2.0 * o).collect();
        gradient.iter_mut().zip(pass.backward(&of_squares)).for_each(|(sum, g)| *sum += g);
        outputs.extend(pass.outputs);
    }
    for backend in BACKENDS {
        let (height, width) = (region.height, region.width);
        let network = Network { shape: setup.shape, features: &features, height, width, backend };
        let (expected, by_burn) =
            network.outputs_and_gradient(&setup.weights, |outputs| outputs.iter().map(|o| 2.0 * o).collect());
        assert_values_close(&format!("{backend} outputs"), &expected, &outputs, NETWORK_TOLERANCE);
        assert_values_close(&format!("{backend} gradient"), &by_burn, &gradient, NETWORK_TOLERANCE);
    }
}

#[test]
fn a_step_is_burns_network_and_the_loss_composed_of_g_c() {
    for form in [Form::Paper, Form::Gated] {
        let setup = Setup::new(form);
        let (loss, gradient) = setup.step(f32::INFINITY, &Workspaces::default());
        let (features, region) = (setup.features(), setup.tiles[0].region);
        for backend in BACKENDS {
            let (height, width) = (region.height, region.width);
            let network = Network { shape: setup.shape, features: &features, height, width, backend };
            let mut composed = 0.0;
            let (_, expected) = network.outputs_and_gradient(&setup.weights, |outputs| {
                let of_tiles = setup.tiles.iter().zip(outputs.chunks_exact(outputs.len() / 2));
                let (losses, gradients): (Vec<f64>, Vec<Vec<f32>>) =
                    of_tiles.map(|(tile, outputs)| setup.loss_of(tile, outputs)).unzip();
                composed = losses.iter().sum();
                gradients.concat()
            });
            assert!((loss / composed - 1.0).abs() <= LOSS_TOLERANCE, "{backend} {form:?}: {loss}, not {composed}");
            assert_values_close(&format!("{backend} {form:?} gradient"), &expected, &gradient, LOSS_TOLERANCE);
        }
    }
}

/// A workspace that other tiles and networks have used leaves no trace.
#[test]
fn a_used_workspace_is_as_good_as_a_new_one() {
    let used = Workspaces::default();
    for (form, width) in [(Form::Gated, 18), (Form::Paper, 18), (Form::Gated, 11), (Form::Gated, 18)] {
        let mut setup = Setup::new(form);
        setup.tiles.iter_mut().for_each(|tile| tile.region.width = width);
        assert_eq!(setup.step(1.0, &used), setup.step(1.0, &Workspaces::default()), "{form:?} {width}");
    }
}

#[test]
fn a_limited_influence_bends_the_gradient_of_outliers_only() {
    let setup = Setup::new(Form::Gated);
    let gradient = |influence: f32| setup.step(influence, &Workspaces::default()).1;
    let free = gradient(f32::INFINITY);
    assert_values_close("a limit far above every error", &free, &gradient(1e6), 1e-6);
    let limited = gradient(0.1);
    let norm = |v: &[f32]| v.iter().map(|x| x * x).sum::<f32>().sqrt();
    assert!(norm(&limited) < 0.5 * norm(&free), "{} is not well below {}", norm(&limited), norm(&free));
}
