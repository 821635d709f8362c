//! Fitted networks with their contract: what a model file holds.

use crate::fits::Fits;
use crate::preset::Settings;
use sspc_cli::{Code, Failure};
use sspc_core::composition::Composition;
use sspc_kernels::features::FeatureSet;
use sspc_onnx::{Contract, Model};

/// The model of a fit: `features` are those of its frames together, `frames` their names, `tool` the program that fitted
/// it and its version; `with_differences`: a frame had differences of y.
///
/// # Errors
/// When the weights do not fit the contract, which training rules out.
pub fn fitted_model(
    settings: &Settings,
    fitted: &Fits,
    features: FeatureSet,
    with_differences: bool,
    frames: Vec<String>,
    tool: &str,
) -> Result<Model, Failure> {
    let mut contract = Contract::new(settings.form);
    contract.shape = settings.shape;
    contract.window_radius = settings.radius;
    contract.exposure = settings.exposure;
    contract.composition = settings.composition;
    contract.features = features;
    // Without a judgement they are of training alone.
    if with_differences && settings.composition == Composition::JudgedFullBuffer {
        contract.differences = settings.difference_strength;
    }
    contract.seed = settings.seed;
    contract.frames = frames;
    contract.tool = tool.into();
    contract.networks = fitted.networks.len();
    contract.preset = settings.preset.to_string();
    contract.steps = fitted.history.len() as u64;
    if !settings.changes.is_empty() {
        contract.extra.insert("settings_changed".into(), settings.changes.join(" "));
    }
    let weights = fitted.networks.iter().flat_map(|network| network.weights.iter().copied()).collect();
    Model::new(contract, weights).map_err(|error| Failure::new(Code::Run, error.to_string(), ""))
}
