//! Our kernels as Burn operations with hand-written backward passes.
//!
//! Burn sees one extension operation, [`differentiable`]: a tensor in, a tensor out, and a closure
//! that turns the upstream gradient into the input's. The network, g_c and the loss are such
//! operations; all of them run core's SIMD kernels on the host, on whichever CPU backend.

// burn-ndarray is deprecated; to keep it working is what the feature is for.
#![cfg_attr(feature = "ndarray", allow(deprecated))]

use burn::backend::autodiff::checkpoint::{base::Checkpointer, strategy::CheckpointStrategy};
use burn::backend::autodiff::grads::Gradients;
use burn::backend::autodiff::ops::{Backward, Ops, OpsKind};
use burn::backend::tensor::FloatTensor;
use burn::backend::{Autodiff, Backend, Dispatch, Flex, TensorMetadata, backend_extension};
use burn::tensor::{Tensor, TensorData, try_read_sync};
use std::fmt;
use std::sync::Arc;

/// Turns the gradient of an operation's output into that of its input, both flat.
pub type Pullback = Arc<dyn Fn(&[f32]) -> Vec<f32> + Send + Sync>;

/// An operation of one input: flat values in; flat values, their shape and the pullback out.
pub trait Operation: Send + Sync {
    fn forward(&self, input: &[f32]) -> (Vec<f32>, Vec<usize>, Pullback);
}

/// The extension trait that Burn dispatches.
#[cfg_attr(feature = "ndarray", backend_extension(Flex, NdArray, Autodiff))]
#[cfg_attr(not(feature = "ndarray"), backend_extension(Flex, Autodiff))]
pub trait OperationBackend: Backend {
    fn apply(input: FloatTensor<Self>, operation: Arc<dyn Operation>) -> FloatTensor<Self> {
        run::<Self>(input, &operation).0
    }
}

impl OperationBackend for Flex {}

#[cfg(feature = "ndarray")]
impl OperationBackend for burn::backend::NdArray {}

fn values<B: Backend>(tensor: FloatTensor<B>) -> Vec<f32> {
    let data = try_read_sync(B::float_into_data(tensor)).expect("CPU backends answer at once").expect("tensor data");
    data.try_into_vec::<f32>().expect("f32 tensors")
}

fn run<B: Backend>(input: FloatTensor<B>, operation: &Arc<dyn Operation>) -> (FloatTensor<B>, Pullback) {
    let device = input.device();
    let (output, shape, pullback) = operation.forward(&values::<B>(input));
    (B::float_from_data(TensorData::new(output, shape), &device), pullback)
}

/// State of the backward pass.
#[derive(Clone)]
struct Saved {
    pullback: Pullback,
    shape: Vec<usize>,
}

impl fmt::Debug for Saved {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Saved").field("shape", &self.shape).finish_non_exhaustive()
    }
}

#[derive(Debug)]
struct PullbackStep;

impl<B: Backend> Backward<B, 1> for PullbackStep {
    type State = Saved;

    fn backward(self, ops: Ops<Saved, 1>, grads: &mut Gradients, _: &mut Checkpointer) {
        let upstream = grads.consume::<B>(&ops.node);
        if let [Some(parent)] = ops.parents {
            let device = upstream.device();
            let gradient = (ops.state.pullback)(&values::<B>(upstream));
            let data = TensorData::new(gradient, ops.state.shape);
            grads.register::<B>(parent.id, B::float_from_data(data, &device));
        }
    }
}

impl<B: OperationBackend, C: CheckpointStrategy> OperationBackend for Autodiff<B, C> {
    fn apply(input: FloatTensor<Self>, operation: Arc<dyn Operation>) -> FloatTensor<Self> {
        let shape = input.shape().to_vec();
        let (primitive, node) = input.into_parts();
        let (output, pullback) = run::<B>(primitive, &operation);
        match PullbackStep.prepare::<C>([node]).compute_bound().stateful() {
            OpsKind::Tracked(prep) => prep.finish(Saved { pullback, shape }, output),
            OpsKind::UnTracked(prep) => prep.finish(output),
        }
    }
}

/// Applies an operation to a tensor; gradients flow through its pullback.
pub fn differentiable<const D: usize, const R: usize>(input: Tensor<D>, operation: Arc<dyn Operation>) -> Tensor<R> {
    Tensor::from_dispatch(<Dispatch as OperationBackend>::apply(input.into_dispatch(), operation))
}
