//! The model whose graphs are imported.

use sspc_core::rng::Rng;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model};

/// Weights and biases that were drawn, not fitted: in Burn's arithmetic and in ours they must mean the same.
pub fn model() -> Model {
    let contract = Contract::new(Form::Gated);
    let mut rng = Rng::new(9);
    let mut weights = Vec::new();
    for l in 0..contract.shape.layers {
        let (inputs, outputs) = contract.shape.channels(l);
        // Of variance 2 / fan-in, so that signals neither vanish nor explode.
        let scale = (2.0 / (9 * inputs) as f32).sqrt();
        weights.extend((0..outputs * inputs * 9).map(|_| scale * rng.normal()));
        weights.extend((0..outputs).map(|_| 0.1 * rng.normal()));
    }
    Model::new(contract, weights).expect("weights of the contract's network")
}
