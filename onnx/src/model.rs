//! A fitted model: its contract and its weights in one flat vector.

use crate::contract::{Contract, INPUT_CHANNELS};
use crate::error::Error;

/// Size of the network: `layers` hidden 3x3 convolutions of `hidden` channels with ReLU, then one
/// 3x3 convolution to the parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    pub hidden: usize,
    pub layers: usize,
}

impl Shape {
    /// The paper's network: eight hidden layers of 16 channels.
    pub const PAPER: Shape = Shape { hidden: 16, layers: 8 };
    /// Largest sizes that are read: far above any use, far below what could exhaust memory.
    pub const MAX: Shape = Shape { hidden: 256, layers: 32 };

    /// (input channels, output channels) of convolution `layer` in `0..=layers`, P outputs in all.
    pub fn channels(self, layer: usize, outputs: usize) -> (usize, usize) {
        let input = if layer == 0 { INPUT_CHANNELS.len() } else { self.hidden };
        let output = if layer == self.layers { outputs } else { self.hidden };
        (input, output)
    }

    /// Number of weights and biases of the whole network.
    pub fn weights(self, outputs: usize) -> usize {
        (0..=self.layers)
            .map(|layer| self.channels(layer, outputs))
            .map(|(input, output)| output * input * 9 + output)
            .sum()
    }

    /// Pixels by which one output depends on inputs around it: one per convolution.
    pub fn receptive_radius(self) -> usize {
        self.layers + 1
    }
}

/// Contract and weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    pub contract: Contract,
    /// Layer after layer: weight `[out][in][3][3]` row-major, then bias `[out]`.
    pub weights: Vec<f32>,
}

/// Weight and bias of one convolution, borrowed from the flat vector.
pub(crate) struct Layer<'a> {
    pub input: usize,
    pub output: usize,
    pub weight: &'a [f32],
    pub bias: &'a [f32],
}

impl Model {
    /// A model whose weights are known to fit its contract.
    ///
    /// # Errors
    /// [`Error::WeightCount`] when their number is not the contract's, [`Error::NotFinite`] when
    /// one of them is NaN or infinite.
    pub fn new(contract: Contract, weights: Vec<f32>) -> Result<Self, Error> {
        let model = Model { contract, weights };
        model.check()?;
        Ok(model)
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        let expected = self.contract.shape.weights(self.contract.form.parameters());
        if self.weights.len() != expected {
            return Err(Error::WeightCount { expected, found: self.weights.len() });
        }
        for (index, layer) in self.layers().enumerate() {
            for (part, values) in [("weight", layer.weight), ("bias", layer.bias)] {
                if let Some(at) = values.iter().position(|w| !w.is_finite()) {
                    let tensor = format!("{}.{part}", layer_name(index));
                    return Err(Error::NotFinite { tensor, index: at, found: values[at] });
                }
            }
        }
        Ok(())
    }

    /// The convolutions in order.
    ///
    /// # Panics
    /// When there are fewer weights than the contract's shape needs.
    pub(crate) fn layers(&self) -> impl Iterator<Item = Layer<'_>> {
        let shape = self.contract.shape;
        let outputs = self.contract.form.parameters();
        let mut rest = &self.weights[..];
        (0..=shape.layers).map(move |layer| {
            let (input, output) = shape.channels(layer, outputs);
            let (weight, tail) = rest.split_at(output * input * 9);
            let (bias, tail) = tail.split_at(output);
            rest = tail;
            Layer { input, output, weight, bias }
        })
    }
}

/// Name of a convolution in the graphs; its initialisers add `.weight` and `.bias`.
pub(crate) fn layer_name(index: usize) -> String {
    format!("conv{index}")
}
