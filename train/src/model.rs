//! The corrector as a Burn module, and the operations that train it.

use crate::operation::{Operation, Pullback, differentiable};
use burn::module::{Module, Param};
use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData, activation, module::conv2d};
use sspc_core::objective::{Objective, Step, Tile, Workspaces};
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_kernels::network::{self, KERNEL, Network, Shape};
use sspc_kernels::simd::Isa;
use std::ops::Range;
use std::sync::Arc;

/// The network's weights in the flat order of [`Network`], one parameter for the optimiser.
#[derive(Module, Debug)]
pub struct Corrector {
    weights: Param<Tensor<1>>,
}

impl Corrector {
    pub fn new(network: &Network, device: &Device) -> Self {
        let data = TensorData::new(network.weights.clone(), [network.weights.len()]);
        Self { weights: Param::from_tensor(Tensor::from_data(data, device).require_grad()) }
    }

    /// The flat weights as a tensor of the graph.
    pub fn weights(&self) -> Tensor<1> {
        self.weights.val()
    }

    /// Identity of the one parameter, under which its gradient is found.
    pub fn id(&self) -> burn::module::ParamId {
        self.weights.id
    }

    /// The weights as plain values.
    pub fn to_vec(&self) -> Vec<f32> {
        to_vec(self.weights.val().inner())
    }
}

/// A tensor's values.
///
/// # Panics
/// When the tensor is not of f32.
pub fn to_vec<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec::<f32>().expect("f32 tensors")
}

/// Tiles of a frame and how they are computed: the constant side of every operation.
#[derive(Clone)]
pub struct TileBatch {
    pub objective: Arc<Objective>,
    pub tiles: Arc<Vec<Tile>>,
    pub shape: Shape,
    pub isa: Isa,
}

impl TileBatch {
    /// Height and width of every tile.
    pub fn size(&self) -> (usize, usize) {
        self.tiles.first().map_or((0, 0), |t| (t.region.height, t.region.width))
    }

    /// The self-supervised loss of flat weights, `[1]`: network, g_c and loss of a tile in one go
    /// ([`Step`]). It is `loss(outputs(weights))`, without a gradient through the `held` outputs.
    pub fn loss_of_weights(
        &self,
        weights: Tensor<1>,
        influence: f32,
        held: Range<usize>,
        workspaces: &Arc<Workspaces>,
    ) -> Tensor<1> {
        let (batch, workspaces) = (self.clone(), workspaces.clone());
        differentiable(weights, Arc::new(StepOperation { batch, influence, held, workspaces }))
    }

    /// Network outputs `[tiles, P, h, w]` of flat weights, through core's convolution kernels.
    pub fn outputs(&self, weights: Tensor<1>) -> Tensor<4> {
        differentiable(weights, Arc::new(NetworkOperation(self.clone())))
    }

    /// The same through Burn's own convolutions: the judge of the operation above.
    pub fn outputs_by_burn(&self, weights: Tensor<1>) -> Tensor<4> {
        let (height, width) = self.size();
        let features = self.objective.tile_features(&self.tiles);
        let data = TensorData::new(features, [self.tiles.len(), FEATURE_CHANNELS, height, width]);
        let mut x = Tensor::<4>::from_data(data, &weights.device());
        for l in 0..self.shape.layers {
            let (inputs, outputs) = self.shape.channels(l);
            let start = self.shape.layer_start(l);
            let kernel = outputs * inputs * KERNEL * KERNEL;
            let w = weights.clone().slice([start..start + kernel]).reshape([outputs, inputs, KERNEL, KERNEL]);
            let b = weights.clone().slice([start + kernel..start + kernel + outputs]);
            x = conv2d(x, w, Some(b), ConvOptions::new([1, 1], [1, 1], [1, 1], 1));
            if l + 1 < self.shape.layers {
                x = activation::relu(x);
            }
        }
        x
    }

    /// Corrected radiance `[tiles, 3, h, w]` of network outputs: g_c with its own backward pass.
    pub fn corrected(&self, outputs: Tensor<4>) -> Tensor<4> {
        differentiable(outputs, Arc::new(CorrectOperation(self.clone())))
    }

    /// The self-supervised loss of network outputs, `[1]`: the mean of Eq. 9 over the tiles' pixels
    /// and channels, forward and backward of g_c in one pass over each tile.
    pub fn loss(&self, outputs: Tensor<4>, influence: f32) -> Tensor<1> {
        differentiable(outputs, Arc::new(LossOperation { batch: self.clone(), influence }))
    }
}

struct StepOperation {
    batch: TileBatch,
    influence: f32,
    held: Range<usize>,
    workspaces: Arc<Workspaces>,
}

impl Operation for StepOperation {
    fn forward(&self, weights: &[f32]) -> (Vec<f32>, Vec<usize>, Pullback) {
        let TileBatch { objective, tiles, shape, isa } = &self.batch;
        let (influence, held) = (self.influence, self.held.clone());
        let step = Step { objective, shape: *shape, isa: *isa, influence, held };
        let (loss, gradient) = step.run(weights, tiles, &self.workspaces);
        (vec![loss as f32], vec![1], scaled_by_upstream(gradient))
    }
}

/// The pullback of an operation whose only output has this gradient.
fn scaled_by_upstream(gradient: Vec<f32>) -> Pullback {
    Arc::new(move |upstream: &[f32]| gradient.iter().map(|g| g * upstream[0]).collect())
}

struct NetworkOperation(TileBatch);

impl Operation for NetworkOperation {
    fn forward(&self, weights: &[f32]) -> (Vec<f32>, Vec<usize>, Pullback) {
        let batch = &self.0;
        let (height, width) = batch.size();
        let features = batch.objective.tile_features(&batch.tiles);
        let (outputs, saved) = network::forward(batch.isa, &batch.shape, weights, &features, height, width);
        let (isa, shape, weights) = (batch.isa, batch.shape, weights.to_vec());
        let pullback = move |upstream: &[f32]| network::backward(isa, &shape, &weights, &saved, upstream);
        (outputs, vec![batch.tiles.len(), shape.outputs, height, width], Arc::new(pullback))
    }
}

struct CorrectOperation(TileBatch);

impl Operation for CorrectOperation {
    fn forward(&self, outputs: &[f32]) -> (Vec<f32>, Vec<usize>, Pullback) {
        let batch = self.0.clone();
        let (height, width) = batch.size();
        let corrected = batch.objective.correct(batch.isa, &batch.tiles, outputs);
        let shape = vec![batch.tiles.len(), 3, height, width];
        let outputs = outputs.to_vec();
        let pullback =
            move |upstream: &[f32]| batch.objective.correct_backward(batch.isa, &batch.tiles, &outputs, upstream);
        (corrected, shape, Arc::new(pullback))
    }
}

struct LossOperation {
    batch: TileBatch,
    influence: f32,
}

impl Operation for LossOperation {
    fn forward(&self, outputs: &[f32]) -> (Vec<f32>, Vec<usize>, Pullback) {
        let TileBatch { objective, tiles, isa, .. } = &self.batch;
        let pixels: usize = tiles.iter().map(|t| t.region.pixels()).sum();
        let scale = 1.0 / (3 * pixels.max(1)) as f32;
        let (loss, gradient) = objective.loss(*isa, tiles, outputs, scale, self.influence);
        (vec![loss as f32], vec![1], scaled_by_upstream(gradient))
    }
}
