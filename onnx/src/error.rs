//! Why a model was refused.

use std::path::PathBuf;

/// A model that this contract does not cover, or bytes that are no model.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum Error {
    #[error("model of {found} bytes: at most {limit} are read")]
    TooLarge { found: u64, limit: u64 },
    #[error("not an ONNX file, or a truncated one")]
    NotOnnx(#[source] prost::DecodeError),
    #[error("the ONNX file has no graph")]
    NoGraph,
    #[error("not a model of this program: its metadata has no `{key}`")]
    MissingKey { key: String },
    #[error("metadata `{key}` is `{found}`, expected {expected}")]
    Key { key: String, expected: String, found: String },
    #[error("contract version {found}, this program reads version {expected}")]
    Version { expected: u32, found: String },
    #[error("tensor `{tensor}` is missing")]
    MissingTensor { tensor: String },
    #[error("tensor `{tensor}` has shape {found:?}, expected {expected:?}")]
    TensorShape { tensor: String, expected: Vec<i64>, found: Vec<i64> },
    #[error("tensor `{tensor}` has ONNX element type {found}, expected {expected} (float32)")]
    TensorType { tensor: String, expected: i32, found: i32 },
    #[error("tensor `{tensor}` holds {found} values, its shape needs {expected}")]
    TensorSize { tensor: String, expected: usize, found: usize },
    #[error("tensor `{tensor}` keeps its data in another file; models must be self-contained")]
    ExternalData { tensor: String },
    #[error("tensor `{tensor}` has the value {found} at index {index}; weights must be finite")]
    NotFinite { tensor: String, index: usize, found: f32 },
    #[error("a network of {found} outputs for a form of {expected} parameters")]
    Outputs { expected: usize, found: usize },
    #[error("{found} weights, the contract's network has {expected}")]
    WeightCount { expected: usize, found: usize },
    #[error("the graph is not the one of this contract: constant `{tensor}` is missing or another")]
    Constant { tensor: String },
    #[error("the graph is not the one of this contract: it has {found} constant tensors, expected {expected}")]
    TensorCount { expected: usize, found: usize },
    #[error("the graph is not the one of this contract: its inputs and outputs are {found}, expected {expected}")]
    Interface { expected: String, found: String },
    #[error("the graph is not the one of this contract: operator {index} is {found}, expected {expected}")]
    Operator { index: usize, expected: String, found: String },
}

/// An [`Error`] and the file it is about.
#[derive(Debug, thiserror::Error)]
#[expect(missing_docs, reason = "the messages say it")]
pub enum FileError {
    #[error("{}: cannot be read: {source}", path.display())]
    Io { path: PathBuf, source: std::io::Error },
    #[error("{}: {source}", path.display())]
    Model { path: PathBuf, source: Error },
}
