//! The corrector as Burn trains it.
//!
//! **Which part is Burn's.** Burn carries the weights, a [`Module`] of one flat parameter on the device of whichever
//! CPU backend, and [`Adam`](burn::optim::Adam) with its moments. The gradient is ours: core's
//! [`Step`](sspc_core::objective::Step) takes each tile through network, g_c and loss and all the way back on one
//! thread while its planes are in that core's cache. Burn's autodiff goes through a whole batch one operation at a
//! time, so that every plane leaves the cache before it is needed again. Nothing is therefore recorded on Burn's graph
//! in a fit; its convolutions and its autodiff judge our kernels in the tests (`tests/tests/burn`).

use crate::backend::Backend;
use burn::module::{Module, Param};
use burn::optim::GradientsParams;
use burn::tensor::{Device, Tensor, TensorData};
use sspc_kernels::network::Network;

/// The network's weights in the flat order of [`Network`], one parameter for the optimiser.
#[derive(Module, Debug)]
pub struct Corrector {
    weights: Param<Tensor<1>>,
}

impl Corrector {
    /// The weights of `network` on a device of `backend`.
    pub fn new(network: &Network, backend: Backend) -> Self {
        // Burn's optimiser takes parameters of its autodiff devices only.
        Self { weights: Param::from_tensor(flat(network.weights.clone(), &backend.device().autodiff())) }
    }

    /// The weights as plain values.
    ///
    /// # Panics
    /// When the device computes in another type than f32.
    pub fn to_vec(&self) -> Vec<f32> {
        self.weights.val().inner().into_data().try_into_vec::<f32>().expect("f32 tensors")
    }

    /// The gradient of the weights, in the same order, as the optimiser takes it.
    pub fn gradients(&self, gradient: Vec<f32>) -> GradientsParams {
        let mut gradients = GradientsParams::new();
        gradients.register(self.weights.id, flat(gradient, &self.weights.val().inner().device()));
        gradients
    }
}

fn flat(values: Vec<f32>, device: &Device) -> Tensor<1> {
    let length = values.len();
    Tensor::from_data(TensorData::new(values, [length]), device)
}
