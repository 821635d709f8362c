//! A tract plan of the network graph at one fixed window size.

use super::fused::fuse;
use sspc_image::Image;
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_kernels::network::WindowNetwork;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_onnx::{Model, write_network};
use std::sync::Arc;
use tract_onnx::prelude::*;
use tract_onnx::tract_core::internal::*;

/// Whose arithmetic runs the network.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernels {
    /// Core's SIMD kernels as an operator of tract.
    Fused(Isa),
    /// tract's own operators: slower, to check against.
    Tract,
}

/// tract did not take the graph, or failed to run it.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "each message says what its fields are")]
pub enum PlanError {
    #[error("tract cannot prepare the network for windows of {height}x{width}: {reason}")]
    Prepare { height: usize, width: usize, reason: String },
    #[error("tract failed to run the network: {reason}")]
    Run { reason: String },
}

/// The runnable network.
pub(super) struct WindowPlan {
    plan: Arc<TypedRunnableModel>,
    kernels: Kernels,
}

impl WindowPlan {
    /// Prepares windows `[13, height, width]` for a model of one network. The graph is written anew from the checked model, so
    /// tract never reads the bytes of a stranger's file.
    pub fn new(model: &Model, kernels: Kernels, height: usize, width: usize) -> Result<Self, PlanError> {
        let prepare = || -> TractResult<_> {
            let bytes = write_network(model);
            let mut graph = tract_onnx::onnx()
                .model_for_read(&mut &bytes[..])?
                .with_input_fact(0, f32::fact([1, FEATURE_CHANNELS, height, width]).into())?
                .into_typed()?;
            if let Kernels::Fused(isa) = kernels {
                let network = WindowNetwork::new(isa, model.contract.form, &model.networks()[0]);
                fuse(&mut graph, Arc::new(network))?;
            }
            graph.into_optimized()?.into_runnable()
        };
        let plan = prepare().map_err(|e| PlanError::Prepare { height, width, reason: format!("{e:#}") })?;
        Ok(Self { plan, kernels })
    }

    /// Activated parameters `[P, wanted.height, wanted.width]` of the pixels `wanted` of a window.
    pub fn run(&self, window: Image, wanted: Region) -> Result<Image, PlanError> {
        let (height, width) = (window.height(), window.width());
        let run = || -> TractResult<Image> {
            let shape = (1, FEATURE_CHANNELS, height, width);
            let features = tract_ndarray::Array4::from_shape_vec(shape, window.into_data())?;
            let mut inputs: TVec<TValue> = tvec!(features.into_tensor().into());
            if let Kernels::Fused(_) = self.kernels {
                let Region { top, left, height, width } = wanted;
                inputs.push(tensor1(&[top, left, height, width].map(|n| n as i64)).into());
            }
            let outputs = self.plan.run(inputs)?;
            let parameters = outputs[0].to_plain_array_view::<f32>()?;
            let values = parameters.as_slice().context("parameters are contiguous")?;
            let planes = values.len() / (height * width).max(1);
            Ok(Image::from_rows(planes, wanted.height, wanted.width, |c, y, row| {
                let from = (c * height + wanted.top + y) * width + wanted.left;
                row.copy_from_slice(&values[from..from + row.len()]);
            }))
        };
        run().map_err(|e| PlanError::Run { reason: format!("{e:#}") })
    }
}
