//! Why a model file was refused.

use std::path::PathBuf;

/// A model outside this contract, or bytes that are not a model. Fields hold what was expected and what was found.
#[allow(missing_docs, reason = "each variant's message is its documentation")]
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum Error {
    #[error("model of {found} bytes; the limit is {limit}")]
    TooLarge { found: u64, limit: u64 },
    #[error("not an ONNX file, or truncated")]
    NotOnnx(#[source] prost::DecodeError),
    #[error("the ONNX file has no graph")]
    NoGraph,
    #[error("not a model of this program: metadata `{key}` is missing")]
    MissingKey { key: String },
    #[error("metadata `{key}` is `{found}`, expected {expected}")]
    Key { key: String, expected: String, found: String },
    #[error("contract version {found}; this program reads version {expected}")]
    Version { expected: u32, found: String },
    #[error("tensor `{tensor}` is missing")]
    MissingTensor { tensor: String },
    #[error("tensor `{tensor}` has shape {found:?}, expected {expected:?}")]
    TensorShape { tensor: String, expected: Vec<i64>, found: Vec<i64> },
    #[error("tensor `{tensor}` has ONNX element type {found}, expected {expected} (float32)")]
    TensorType { tensor: String, expected: i32, found: i32 },
    #[error("tensor `{tensor}` holds {found} values; its shape needs {expected}")]
    TensorSize { tensor: String, expected: usize, found: usize },
    #[error("tensor `{tensor}` stores its data in another file; models must be self-contained")]
    ExternalData { tensor: String },
    #[error("tensor `{tensor}` has the value {found} at index {index}; weights must be finite")]
    NotFinite { tensor: String, index: usize, found: f32 },
    #[error("the network has {found} outputs; the form has {expected} parameters")]
    Outputs { expected: usize, found: usize },
    #[error("{found} weights; the contract's network has {expected}")]
    WeightCount { expected: usize, found: usize },
    #[error("the graph is not that of this contract: constant `{tensor}` is missing or differs")]
    Constant { tensor: String },
    #[error("the graph is not that of this contract: it has {found} constant tensors, expected {expected}")]
    TensorCount { expected: usize, found: usize },
    #[error("the graph is not that of this contract: its inputs and outputs are {found}, expected {expected}")]
    Interface { expected: String, found: String },
    #[error("the graph is not that of this contract: operator {index} is {found}, expected {expected}")]
    Operator { index: usize, expected: String, found: String },
}

/// An error and the file it concerns.
#[allow(missing_docs, reason = "each variant's message is its documentation")]
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum FileError {
    #[error("{}: cannot be read: {source}", path.display())]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{}: {source}", path.display())]
    Model { path: PathBuf, source: Error },
}
