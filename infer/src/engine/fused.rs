//! The whole network as one operator of tract that runs our kernels.
//!
//! **What tract still does here.** It reads the graph that the contract writes, types it for one window size, checks
//! that its input and output are what the contract says, and schedules one operator: ours, put in the place of
//! everything between them. The convolutions and activations of the file are not computed by tract: its own
//! convolution takes about twice the time of onnxruntime's for layers this narrow. `--kernels tract` runs the file's
//! operators as they stand, which is what the tests compare this one with.

use sspc_kernels::network::WindowNetwork;
use sspc_kernels::region::Region;
use std::sync::Arc;
use tract_onnx::prelude::*;
use tract_onnx::tract_core::internal::*;

/// features `[1, 13, H, W]` and the wanted pixels `[top, left, height, width]` -> activated
/// parameters `[1, P, H, W]`, zero where they are not wanted.
#[derive(Clone, Debug)]
struct FusedNetwork(Arc<WindowNetwork>);

impl PartialEq for FusedNetwork {
    fn eq(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.0, &other.0)
    }
}

impl Eq for FusedNetwork {}

impl Op for FusedNetwork {
    fn name(&self) -> StaticName {
        "SspcNetwork".into()
    }

    op_as_typed_op!();
}

impl EvalOp for FusedNetwork {
    op_out_of_plan!();

    fn eval(&self, _: &EvalContext, inputs: TVec<TValue>) -> TractResult<TVec<TValue>> {
        let features = inputs[0].to_plain_array_view::<f32>()?;
        let &[_, _, height, width] = features.shape() else {
            bail!("features of rank {}, expected 4", features.ndim())
        };
        let features = features.as_slice().context("features are contiguous")?;
        let wanted = inputs[1].to_plain_array_view::<i64>()?;
        let &[top, left, inner_height, inner_width] = wanted.as_slice().context("wanted pixels")? else {
            bail!("wanted pixels of length {}, expected 4", wanted.len())
        };
        let [top, left] = [top as usize, left as usize];
        let inner = Region { top, left, height: inner_height as usize, width: inner_width as usize };
        let outputs = self.0.shape().outputs;
        let mut wanted = vec![0.0; outputs * inner.pixels()];
        self.0.run_inner(features, height, width, inner, &mut wanted);
        let mut parameters = vec![0.0; outputs * height * width];
        for (row, values) in wanted.chunks_exact(inner.width).enumerate() {
            let (c, y) = (row / inner.height, row % inner.height);
            let start = (c * height + inner.top + y) * width + inner.left;
            parameters[start..start + inner.width].copy_from_slice(values);
        }
        let array = tract_ndarray::Array4::from_shape_vec((1, outputs, height, width), parameters)?;
        Ok(tvec!(array.into_tensor().into_tvalue()))
    }
}

impl TypedOp for FusedNetwork {
    as_op!();

    fn output_facts(&self, inputs: &[&TypedFact]) -> TractResult<TVec<TypedFact>> {
        let mut fact = inputs[0].datum_type.fact(inputs[0].shape.iter().cloned());
        fact.shape.set(1, self.0.shape().outputs.to_dim());
        Ok(tvec!(fact))
    }
}

/// Replaces everything between the model's one input and one output; the wanted pixels become its
/// second input.
pub(super) fn fuse(model: &mut TypedModel, network: Arc<WindowNetwork>) -> TractResult<()> {
    let (input, output) = (model.input_outlets()?[0], model.output_outlets()?[0]);
    let wanted = model.add_source("wanted", i64::fact([4]))?;
    let mut patch = TypedModelPatch::default();
    let features = patch.tap_model(model, input)?;
    let wanted = patch.tap_model(model, wanted)?;
    let fused = patch.wire_node("network", FusedNetwork(network), &[features, wanted])?[0];
    patch.shunt_outside(model, output, fused)?;
    patch.apply(model)
}
