//! Models as files: warm starts and export.

use crate::cli::{ExportArgs, Graph};
use crate::error::Error;
use crate::preset::Settings;
use sspc_kernels::network::Network;
use sspc_onnx::{Model, load_model, write_image, write_network};
use std::path::Path;

/// Network of a fitted model to start from; form, window, exposure, composition and features of the
/// settings become the model's.
///
/// # Errors
/// [`Error::Model`] when the file is no model.
pub fn load(path: &Path, settings: &mut Settings) -> Result<Network, Error> {
    let model = read(path)?;
    settings.form = model.contract.form;
    settings.shape = model.contract.shape;
    settings.radius = model.contract.window_radius;
    settings.exposure = model.contract.exposure;
    settings.composition = model.contract.composition;
    settings.features = model.contract.features;
    Ok(model.network())
}

fn read(path: &Path) -> Result<Model, Error> {
    load_model(path).map_err(|source| Error::Model { path: path.to_path_buf(), source })
}

/// `sspc-train export`.
///
/// # Errors
/// What reading the model and writing the file can raise.
pub fn export(args: &ExportArgs) -> Result<(), Error> {
    let path = if args.model.is_dir() { args.model.join("model.onnx") } else { args.model.clone() };
    let model = read(&path)?;
    let bytes = match args.graph {
        Graph::Network => write_network(&model),
        Graph::Image => write_image(&model),
    };
    Ok(sspc_frames::atomic::atomic_write_bytes(&args.output, &[path], &bytes)?)
}
