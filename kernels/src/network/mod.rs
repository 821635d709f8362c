//! The network of the corrector: 3x3 convolutions with ReLU and zero 'same' padding.
//!
//! Thirteen feature channels in, a handful of hidden layers of sixteen channels, one output channel
//! per parameter of g_c ([`crate::parameters`]). [`PackedNetwork`] takes a tile through the SIMD kernels
//! and back, [`WindowNetwork`] streams the windows of a picture through them; the naive f64 twin lives
//! in [`oracle`].

mod conv;
pub mod oracle;
mod planes;
mod points;
mod rows;
mod tile_convolution;
mod trunk;
mod weight_gradient;
mod window;

pub use trunk::{GradientPlanes, PackedNetwork, TilePlanes, sum_in_order};
pub use window::WindowNetwork;

use crate::features::FEATURE_CHANNELS;
use crate::parameters::Form;

/// Side of every convolution kernel.
pub const KERNEL: usize = 3;
/// Most channels that a layer may have: the kernels work in blocks of sixteen.
pub const MAX_CHANNELS: usize = 16;

/// Channels and layers of a network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Shape {
    /// Channels of every hidden layer, 1..=16.
    pub hidden: usize,
    /// Convolutions, the last one included, >= 1.
    pub layers: usize,
    /// Output channels, 1..=16.
    pub outputs: usize,
}

impl Shape {
    /// The paper's network: eight hidden layers of sixteen channels and one to the parameters.
    pub fn paper(form: Form) -> Self {
        Self { hidden: 16, layers: 9, outputs: form.parameters() }
    }

    /// Two hidden layers of sixteen channels and one to the parameters. Fitted to one frame, with
    /// as many steps, it comes closer to the truth than the paper's nine layers, in less time
    /// (`bench/run --ablations`): there is less to learn from noise.
    pub fn shallow(form: Form) -> Self {
        Self { layers: 3, ..Self::paper(form) }
    }

    /// Pixels that an output depends on to every side.
    pub fn radius(&self) -> usize {
        self.layers * (KERNEL / 2)
    }

    /// Input and output channels of layer `l`.
    pub fn channels(&self, l: usize) -> (usize, usize) {
        let inputs = if l == 0 { FEATURE_CHANNELS } else { self.hidden };
        let outputs = if l + 1 == self.layers { self.outputs } else { self.hidden };
        (inputs, outputs)
    }

    /// Weights and biases of layer `l`.
    pub fn layer_len(&self, l: usize) -> usize {
        let (inputs, outputs) = self.channels(l);
        outputs * (inputs * KERNEL * KERNEL + 1)
    }

    /// Where layer `l` starts in the flat weights.
    pub fn layer_start(&self, l: usize) -> usize {
        (0..l).map(|l| self.layer_len(l)).sum()
    }

    /// All weights and biases: 20 303 for the paper's form.
    pub fn parameter_count(&self) -> usize {
        self.layer_start(self.layers)
    }
}

/// A network: its shape and all weights in one flat vector, for each layer the kernel
/// `[output][input][3][3]` and then the bias `[output]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// Channels and layers.
    pub shape: Shape,
    /// [`Shape::parameter_count`] weights and biases.
    pub weights: Vec<f32>,
}

impl Network {
    /// Kernel and bias of layer `l`.
    pub fn layer(&self, l: usize) -> (&[f32], &[f32]) {
        layer(&self.shape, &self.weights, l)
    }
}

/// Kernel and bias of layer `l` in flat `weights`.
pub fn layer<'a, T>(shape: &Shape, weights: &'a [T], l: usize) -> (&'a [T], &'a [T]) {
    let start = shape.layer_start(l);
    let (inputs, outputs) = shape.channels(l);
    weights[start..start + shape.layer_len(l)].split_at(outputs * inputs * KERNEL * KERNEL)
}
