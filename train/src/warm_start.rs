//! Training that starts from a fitted model.

use crate::preset::Settings;
use sspc_cli::{Code, Failure};
use sspc_kernels::network::Network;
use sspc_onnx::{Model, load_model};
use std::path::Path;

/// Networks of a fitted model to start from; form, window, exposure, composition and features of the settings become the
/// model's.
pub fn begin(model: &Model, settings: &mut Settings) -> Vec<Network> {
    settings.form = model.contract.form;
    settings.shape = model.contract.shape;
    settings.radius = model.contract.window_radius;
    // It was fitted to the whole window.
    settings.early_radius = settings.radius;
    settings.exposure = model.contract.exposure;
    settings.composition = model.contract.composition;
    settings.features = model.contract.features;
    model.networks()
}

/// A fitted model.
///
/// # Errors
/// When the file is no model.
pub fn read_model(path: &Path) -> Result<Model, Failure> {
    let advice = "give a model.onnx that sspc-train fit wrote";
    load_model(path).map_err(|error| Failure::new(Code::Input, error.to_string(), advice))
}
