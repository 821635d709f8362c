//! Twenty lines of training loop that take their tiles from a case instead of drawing them.

use crate::convolutions;
use burn::optim::AdamConfig;
use sspc_core::objective::{self, Objective, PixelLoss, Tile, Workspaces};
use sspc_kernels::network::Network;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_testkit::kernels::{features_of, loss_of_tiles};
use sspc_train::backend::Backend;
use sspc_train::model::Corrector;

/// Kingma and Ba's own epsilon, as in every fit; Burn's default is another.
pub const EPSILON: f32 = 1e-8;

/// Which convolutions run the network.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Convolutions {
    /// sspc-core's kernels, as in every fit.
    Kernels,
    /// The backend's own, through Burn's autodiff.
    Burns,
}

/// What a step trains on and how fast: top and left of every tile, and the rate.
pub struct Step {
    pub origins: Vec<(usize, usize)>,
    pub rate: f64,
}

/// Carries the steps out; every step's loss before its update, and the final network.
pub fn train(
    objective: &Objective,
    start: Network,
    size: (usize, usize),
    steps: &[Step],
    epsilon: f32,
    backend: Backend,
    convolutions: Convolutions,
) -> (Vec<f64>, Network) {
    let shape = start.shape;
    let mut model = Corrector::new(&start, backend);
    let mut optimiser = AdamConfig::new().with_epsilon(epsilon).init();
    let (workspaces, isa) = (Workspaces::default(), Isa::best());
    let mut losses = Vec::new();
    for step in steps {
        let tiles = step.origins.iter().flat_map(|&(top, left)| {
            let region = Region { top, left, height: size.0, width: size.1 };
            (0..2).map(move |half| Tile::upright(half, region))
        });
        let (tiles, weights): (Vec<Tile>, _) = (tiles.collect(), model.to_vec());
        let (loss, gradient) = match convolutions {
            Convolutions::Kernels => {
                let step = objective::Step { objective, shape, isa, influence: f32::INFINITY, frozen_outputs: 0..0 };
                step.run(&weights, &tiles, &workspaces)
            }
            Convolutions::Burns => {
                let features: Vec<f32> = tiles.iter().flat_map(|tile| features_of(objective, tile)).collect();
                let (height, width) = size;
                let network = convolutions::Network { shape, features: &features, height, width, backend };
                let scale = 1.0 / (3 * height * width * tiles.len()) as f32;
                let measure = PixelLoss { scale, influence: f32::INFINITY };
                let mut loss = 0.0;
                let (_, gradient) = network.outputs_and_gradient(&weights, |outputs| {
                    let (value, gradient) = loss_of_tiles(objective, isa, &tiles, outputs, measure);
                    loss = value;
                    gradient
                });
                (loss, gradient)
            }
        };
        losses.push(loss);
        let gradients = model.gradients(gradient);
        model = optimiser.step(step.rate, model, gradients);
    }
    (losses, Network { shape, weights: model.to_vec() })
}
