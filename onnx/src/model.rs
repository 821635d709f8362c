//! A fitted model: its contract and its weights in one flat vector.

use crate::contract::Contract;
use crate::error::Error;
use sspc_kernels::network::{Network, layer};

/// Contract and weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// What the model is.
    pub contract: Contract,
    /// Layer after layer: weight `[out][in][3][3]` row-major, then bias `[out]`.
    pub weights: Vec<f32>,
}

impl Model {
    /// A model whose weights are known to fit its contract.
    ///
    /// # Errors
    /// [`Error::Outputs`] when the shape has other outputs than the form has parameters,
    /// [`Error::WeightCount`] when the number of weights is not the contract's, [`Error::NotFinite`] when
    /// one of them is NaN or infinite.
    pub fn new(contract: Contract, weights: Vec<f32>) -> Result<Self, Error> {
        let model = Model { contract, weights };
        model.check()?;
        Ok(model)
    }

    /// The network as core's kernels take it.
    pub fn network(&self) -> Network {
        Network { shape: self.contract.shape, weights: self.weights.clone() }
    }

    fn check(&self) -> Result<(), Error> {
        let Contract { form, shape, .. } = self.contract;
        if shape.outputs != form.parameters() {
            return Err(Error::Outputs { expected: form.parameters(), found: shape.outputs });
        }
        let expected = shape.parameter_count();
        if self.weights.len() != expected {
            return Err(Error::WeightCount { expected, found: self.weights.len() });
        }
        for l in 0..shape.layers {
            let (weight, bias) = self.layer(l);
            for (part, values) in [("weight", weight), ("bias", bias)] {
                if let Some(at) = values.iter().position(|w| !w.is_finite()) {
                    let tensor = format!("{}.{part}", layer_name(l));
                    return Err(Error::NotFinite { tensor, index: at, found: values[at] });
                }
            }
        }
        Ok(())
    }

    /// Kernel and bias of convolution `l`.
    pub(crate) fn layer(&self, l: usize) -> (&[f32], &[f32]) {
        layer(&self.contract.shape, &self.weights, l)
    }
}

/// Name of a convolution in the graphs; its initialisers add `.weight` and `.bias`.
pub(crate) fn layer_name(index: usize) -> String {
    format!("conv{index}")
}
