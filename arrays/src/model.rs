//! A fitted model from a file or from bytes.

use sspc_cli::{Code, Failure};
use sspc_onnx::{Model, load_model, read_model};
use std::path::Path;

fn refused(error: &dyn std::error::Error) -> Failure {
    Failure::new(Code::Input, error.to_string(), "give a model.onnx that sspc-train fit or export wrote")
}

/// Reads a model's file, any of its graphs.
///
/// # Errors
/// When it cannot be read or is no model.
pub fn of_file(path: &Path) -> Result<Model, Failure> {
    load_model(path).map_err(|error| refused(&error))
}

/// Reads the bytes of such a file.
///
/// # Errors
/// When they are no model.
pub fn of_bytes(bytes: &[u8]) -> Result<Model, Failure> {
    read_model(bytes).map_err(|error| refused(&error))
}
