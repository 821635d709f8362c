//! A fitted model: its contract and its weights in one flat vector.

use crate::contract::Contract;
use crate::error::Error;
use sspc_kernels::network::{Network, layer};

/// Contract and weights.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// What the model states about itself.
    pub contract: Contract,
    /// Network after network, layer after layer: weight `[out][in][3][3]` row-major, then bias `[out]`.
    pub weights: Vec<f32>,
}

impl Model {
    /// Checks that the weights fit the contract.
    ///
    /// # Errors
    /// [`Error::Outputs`] when the shape's outputs are not the form's parameters, [`Error::WeightCount`] when the number
    /// of weights is not the contract's, [`Error::NotFinite`] when a weight is NaN or infinite.
    pub fn new(contract: Contract, weights: Vec<f32>) -> Result<Self, Error> {
        let model = Model { contract, weights };
        model.check()?;
        Ok(model)
    }

    /// The networks for our kernels, in the order of the denoised pictures.
    pub fn networks(&self) -> Vec<Network> {
        let shape = self.contract.shape;
        let of = |weights: &[f32]| Network { shape, weights: weights.to_vec() };
        self.weights.chunks_exact(shape.parameter_count()).map(of).collect()
    }

    /// A model of network `k` alone.
    ///
    /// # Panics
    /// When there is no such network.
    pub fn of_network(&self, k: usize) -> Model {
        let count = self.contract.shape.parameter_count();
        let contract = Contract { networks: 1, ..self.contract.clone() };
        Model { contract, weights: self.weights[k * count..(k + 1) * count].to_vec() }
    }

    fn check(&self) -> Result<(), Error> {
        let Contract { form, shape, .. } = self.contract;
        if shape.outputs != form.parameters() {
            return Err(Error::Outputs { expected: form.parameters(), found: shape.outputs });
        }
        let expected = self.contract.networks * shape.parameter_count();
        if self.weights.len() != expected {
            return Err(Error::WeightCount { expected, found: self.weights.len() });
        }
        for (k, l) in (0..self.contract.networks).flat_map(|k| (0..shape.layers).map(move |l| (k, l))) {
            let (weight, bias) = self.layer(k, l);
            for (part, values) in [("weight", weight), ("bias", bias)] {
                if let Some(at) = values.iter().position(|w| !w.is_finite()) {
                    let tensor = format!("{}{}.{part}", prefix(k), layer_name(l));
                    return Err(Error::NotFinite { tensor, index: at, found: values[at] });
                }
            }
        }
        Ok(())
    }

    /// Kernel and bias of convolution `l` of network `k`.
    pub(crate) fn layer(&self, k: usize, l: usize) -> (&[f32], &[f32]) {
        let shape = &self.contract.shape;
        layer(shape, &self.weights[k * shape.parameter_count()..], l)
    }
}

/// What the names of network `k` in a graph of several begin with: nothing for the first.
pub(crate) fn prefix(k: usize) -> String {
    if k == 0 { String::new() } else { format!("z{}_", k + 1) }
}

/// Name of a convolution in the graphs; its initialisers add `.weight` and `.bias`.
pub(crate) fn layer_name(index: usize) -> String {
    format!("conv{index}")
}
