//! The network by Burn's own convolutions, and its gradient by Burn's autodiff: the judge of our kernels.

use burn::tensor::ops::ConvOptions;
use burn::tensor::{Device, Tensor, TensorData, activation, module::conv2d};
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_kernels::network::{KERNEL, Shape};
use sspc_train::backend::Backend;

/// Tiles of features on a backend, and the network that they go through.
pub struct Network<'a> {
    pub shape: Shape,
    /// `[tiles, 13, height, width]`
    pub features: &'a [f32],
    pub height: usize,
    pub width: usize,
    pub backend: Backend,
}

impl Network<'_> {
    /// Outputs before activation, `[tiles, P, height, width]`, of flat `weights`.
    pub fn outputs(&self, weights: &[f32]) -> Vec<f32> {
        let device = self.backend.device();
        values(self.run(tensor([weights.len()], weights, &device), &device))
    }

    /// Outputs, and the gradient of the flat `weights` that Burn's autodiff finds, given that of the outputs.
    pub fn outputs_and_gradient(
        &self,
        weights: &[f32],
        upstream: impl FnOnce(&[f32]) -> Vec<f32>,
    ) -> (Vec<f32>, Vec<f32>) {
        let device = self.backend.device().autodiff();
        let leaf: Tensor<1> = tensor([weights.len()], weights, &device).require_grad();
        let outputs = self.run(leaf.clone(), &device);
        let found = values(outputs.clone().inner());
        let upstream = tensor(outputs.dims(), &upstream(&found), &device);
        // The gradient of Σ G·o by the weights is that of any loss whose gradient by o is G.
        let gradients = (outputs * upstream).sum().backward();
        (found, values(leaf.grad(&gradients).expect("the weights are tracked")))
    }

    fn run(&self, weights: Tensor<1>, device: &Device) -> Tensor<4> {
        let tiles = self.features.len() / (FEATURE_CHANNELS * self.height * self.width);
        let mut x = tensor([tiles, FEATURE_CHANNELS, self.height, self.width], self.features, device);
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
}

fn tensor<const D: usize>(shape: [usize; D], values: &[f32], device: &Device) -> Tensor<D> {
    Tensor::from_data(TensorData::new(values.to_vec(), shape), device)
}

fn values<const D: usize>(tensor: Tensor<D>) -> Vec<f32> {
    tensor.into_data().try_into_vec::<f32>().expect("f32 tensors")
}
