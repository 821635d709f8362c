//! The whole network as one tract operator that runs core's kernels.
//!
//! tract's own convolution takes about twice the time of onnxruntime's for layers this narrow. The
//! file is still read, typed and checked by tract; between its input and its output the operators
//! are replaced by one.

use sspc_core::network::WindowNetwork;
use std::sync::Arc;
use tract_onnx::prelude::*;
use tract_onnx::tract_core::internal::*;

/// features `[1, 13, H, W]` -> activated parameters `[1, P, H, W]`.
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
        let outputs = self.0.shape().outputs;
        let mut parameters = vec![0.0; outputs * height * width];
        self.0.run(features, height, width, &mut parameters);
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

/// Replaces everything between the model's one input and one output.
pub(super) fn fuse(model: &mut TypedModel, network: Arc<WindowNetwork>) -> TractResult<()> {
    let (input, output) = (model.input_outlets()?[0], model.output_outlets()?[0]);
    let mut patch = TypedModelPatch::default();
    let features = patch.tap_model(model, input)?;
    let fused = patch.wire_node("network", FusedNetwork(network), &[features])?[0];
    patch.shunt_outside(model, output, fused)?;
    patch.apply(model)
}
