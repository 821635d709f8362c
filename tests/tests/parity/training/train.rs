//! Twenty lines of training loop that take their tiles from a case instead of drawing them.

use burn::optim::{AdamConfig, GradientsParams};
use sspc_core::objective::{Objective, Tile};
use sspc_kernels::network::{Network, Shape};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_train::backend::Backend;
use sspc_train::model::{Corrector, TileBatch};
use std::sync::Arc;

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

/// Every backend that is built in.
pub const BACKENDS: [Backend; 2] = [Backend::Flex, Backend::Ndarray];

/// What a step trains on and how fast: top and left of every tile, and the rate.
pub struct Step {
    pub origins: Vec<(usize, usize)>,
    pub rate: f64,
}

/// Carries the steps out; every step's loss before its update, and the final network.
pub fn train(
    objective: &Arc<Objective>,
    start: Network,
    size: (usize, usize),
    steps: &[Step],
    epsilon: f32,
    backend: Backend,
    convolutions: Convolutions,
) -> (Vec<f64>, Network) {
    let shape: Shape = start.shape;
    let mut model = Corrector::new(&start, &backend.device().autodiff());
    let mut optimiser = AdamConfig::new().with_epsilon(epsilon).init();
    let mut losses = Vec::new();
    for step in steps {
        let tiles = step.origins.iter().flat_map(|&(top, left)| {
            let region = Region { top, left, height: size.0, width: size.1 };
            (0..2).map(move |half| Tile::upright(half, region))
        });
        let tiles = Arc::new(tiles.collect());
        let batch = TileBatch { objective: objective.clone(), tiles, shape, isa: Isa::best() };
        let outputs = match convolutions {
            Convolutions::Kernels => batch.outputs(model.weights()),
            Convolutions::Burns => batch.outputs_by_burn(model.weights()),
        };
        let loss = batch.loss(outputs, f32::INFINITY);
        losses.push(f64::from(loss.clone().into_scalar::<f32>()));
        let gradients = GradientsParams::from_grads(loss.backward(), &model);
        model = optimiser.step(step.rate, model, gradients);
    }
    (losses, Network { shape, weights: model.to_vec() })
}
