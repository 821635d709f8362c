//! Reads a model from any graph that this crate writes.
//!
//! Files are not trusted: their size is bounded before decoding, shapes are compared with the contract before values are
//! copied, and the operators must be those that this crate writes, so that what we compute is what the file describes.

use crate::contract::Contract;
use crate::error::{Error, FileError};
use crate::image_graph::{IMAGE_GRAPH, write_image};
use crate::messages::{GraphProto, ModelProto, NodeProto, TensorProto, ValueInfoProto, data_type};
use crate::metadata;
use crate::model::{Model, layer_name, prefix};
use crate::network_graph::write_network;
use crate::picture::{OPERATORS_GRAPH, PICTURE_GRAPH, write_operators, write_picture};
use prost::Message;
use sspc_image::shown;
use std::io::Read;
use std::path::Path;

/// Size limit of a file: the largest network of the contract takes 300 kB, the image graph around it 60 kB, and the names
/// of training frames the rest. An empty message of two bytes decodes to a structure of about a hundred, so this also
/// bounds the memory that a file can claim, to about a hundred times its size.
pub const MAX_FILE_BYTES: u64 = 2 << 20;

/// `TensorProto.DataLocation.EXTERNAL`.
const EXTERNAL: i32 = 1;

/// Which graph a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GraphKind {
    /// Features to parameters.
    Network,
    /// Buffers to the corrected picture.
    Image,
    /// Buffers to the finished picture.
    Picture,
    /// The same with an operator of our own.
    Operators,
}

/// Reads and checks a model file.
///
/// # Errors
/// [`FileError::Io`] when it cannot be read, [`FileError::Model`] when [`read_model`] refuses it.
pub fn load_model(path: &Path) -> Result<Model, FileError> {
    load_model_and_kind(path).map(|(model, _)| model)
}

/// The same, and which graph the file holds.
///
/// # Errors
/// As [`load_model`].
pub fn load_model_and_kind(path: &Path) -> Result<(Model, GraphKind), FileError> {
    let io = |source| FileError::Io { path: path.to_path_buf(), source };
    let meta = std::fs::metadata(path).map_err(io)?;
    if !meta.is_file() {
        // A pipe or device would block or never end.
        return Err(io(std::io::Error::other("not a regular file")));
    }
    let file = std::fs::File::open(path).map_err(io)?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(io)?;
    let refused = |source| FileError::Model { path: path.to_path_buf(), source };
    Ok((read_model(&bytes).map_err(refused)?, read_graph_kind(&bytes).map_err(refused)?))
}

/// Reads contract and weights from the bytes of any of the graphs.
///
/// # Errors
/// Every variant of [`Error`]; the first that applies in the order size, encoding, contract,
/// weights, constants, operators.
pub fn read_model(bytes: &[u8]) -> Result<Model, Error> {
    let (contract, graph) = decode(bytes)?;
    let mut weights = Vec::new();
    for (k, l) in (0..contract.networks).flat_map(|k| (0..contract.shape.layers).map(move |l| (k, l))) {
        let (input, output) = contract.shape.channels(l);
        let name = format!("{}{}", prefix(k), layer_name(l));
        append(&graph, &format!("{name}.weight"), &[output, input, 3, 3], &mut weights)?;
        append(&graph, &format!("{name}.bias"), &[output], &mut weights)?;
    }
    let model = Model::new(contract, weights)?;
    let expected = match kind(&graph) {
        GraphKind::Network => write_network(&model),
        GraphKind::Image => write_image(&model),
        GraphKind::Picture => write_picture(&model),
        GraphKind::Operators => write_operators(&model),
    };
    let expected = ModelProto::decode(&expected[..]).map_err(Error::NotOnnx)?;
    let expected = expected.graph.ok_or(Error::NoGraph)?;
    same_constants(&expected, &graph)?;
    same_interface(&expected, &graph)?;
    same_operators(&expected, &graph)?;
    Ok(model)
}

/// Which graph the bytes hold.
///
/// # Errors
/// As [`read_model`], for size, encoding and contract.
pub fn read_graph_kind(bytes: &[u8]) -> Result<GraphKind, Error> {
    decode(bytes).map(|(_, graph)| kind(&graph))
}

fn decode(bytes: &[u8]) -> Result<(Contract, GraphProto), Error> {
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(Error::TooLarge { found: bytes.len() as u64, limit: MAX_FILE_BYTES });
    }
    let file = ModelProto::decode(bytes).map_err(Error::NotOnnx)?;
    let graph = file.graph.ok_or(Error::NoGraph)?;
    Ok((metadata::read(&file.metadata_props)?, graph))
}

fn kind(graph: &GraphProto) -> GraphKind {
    match graph.name.as_deref() {
        Some(IMAGE_GRAPH) => GraphKind::Image,
        Some(PICTURE_GRAPH) => GraphKind::Picture,
        Some(OPERATORS_GRAPH) => GraphKind::Operators,
        _ => GraphKind::Network,
    }
}

fn append(graph: &GraphProto, name: &str, shape: &[usize], weights: &mut Vec<f32>) -> Result<(), Error> {
    let tensor = graph
        .initializer
        .iter()
        .find(|t| t.name.as_deref() == Some(name))
        .ok_or_else(|| Error::MissingTensor { tensor: name.into() })?;
    weights.extend(values(tensor, name, shape)?);
    Ok(())
}

/// The values of a float32 tensor of a known shape, from either field in which ONNX stores them.
fn values(tensor: &TensorProto, name: &str, shape: &[usize]) -> Result<Vec<f32>, Error> {
    let name = || name.to_string();
    if tensor.data_location == Some(EXTERNAL) || !tensor.external_data.is_empty() {
        return Err(Error::ExternalData { tensor: name() });
    }
    let found = tensor.data_type.unwrap_or(0);
    if found != data_type::FLOAT {
        return Err(Error::TensorType { tensor: name(), expected: data_type::FLOAT, found });
    }
    let expected: Vec<i64> = shape.iter().map(|&d| d as i64).collect();
    if tensor.dims != expected {
        let found = tensor.dims.iter().copied().take(8).collect();
        return Err(Error::TensorShape { tensor: name(), expected, found });
    }
    let count: usize = shape.iter().product();
    let size_error = |found| Error::TensorSize { tensor: name(), expected: count, found };
    match &tensor.raw_data {
        Some(raw) if raw.len() == 4 * count && tensor.float_data.is_empty() => {
            let (quads, _) = raw.as_chunks::<4>();
            Ok(quads.iter().map(|quad| f32::from_le_bytes(*quad)).collect())
        }
        Some(raw) => Err(size_error(raw.len() / 4 + tensor.float_data.len())),
        None if tensor.float_data.len() == count => Ok(tensor.float_data.clone()),
        None => Err(size_error(tensor.float_data.len())),
    }
}

/// Checks that every constant other than a weight has the value of this contract, and that there are no others: of two
/// tensors of one name, another engine may use the other one.
fn same_constants(expected: &GraphProto, found: &GraphProto) -> Result<(), Error> {
    let is_weight = |name: &str| name.ends_with(".weight") || name.ends_with(".bias");
    let name = |tensor: &TensorProto| tensor.name.clone().unwrap_or_default();
    for constant in expected.initializer.iter().filter(|t| !is_weight(&name(t))) {
        if !found.initializer.contains(constant) {
            return Err(Error::Constant { tensor: name(constant) });
        }
    }
    match (expected.initializer.len(), found.initializer.len()) {
        (expected, found) if expected == found => Ok(()),
        (expected, found) => Err(Error::TensorCount { expected, found }),
    }
}

/// Checks the names of inputs and outputs; their sizes may be fixed to those of a frame.
fn same_interface(expected: &GraphProto, found: &GraphProto) -> Result<(), Error> {
    let names = |values: &[ValueInfoProto]| {
        let names: Vec<&str> = values.iter().map(|value| value.name.as_deref().unwrap_or("?")).collect();
        names.join(", ")
    };
    let whole = |graph: &GraphProto| format!("{} to {}", names(&graph.input), names(&graph.output));
    match (whole(expected), whole(found)) {
        (expected, found) if expected == found => Ok(()),
        (expected, found) => Err(Error::Interface { expected, found: shown(&found) }),
    }
}

/// Checks that the same operators act on the same values in the same order, subgraphs included.
fn same_operators(expected: &GraphProto, found: &GraphProto) -> Result<(), Error> {
    let count = expected.node.len().max(found.node.len());
    for index in 0..count {
        let (expected, found) = (expected.node.get(index), found.node.get(index));
        if !matches!((expected, found), (Some(e), Some(f)) if same_node(e, f)) {
            let describe = |node: Option<&NodeProto>| match node {
                Some(node) => format!("{} of {}", node.op_type.as_deref().unwrap_or("?"), node.input.join(", ")),
                None => "no operator".to_string(),
            };
            return Err(Error::Operator { index, expected: describe(expected), found: shown(&describe(found)) });
        }
    }
    Ok(())
}

fn same_node(expected: &NodeProto, found: &NodeProto) -> bool {
    expected.op_type == found.op_type
        && expected.domain.as_deref().unwrap_or("") == found.domain.as_deref().unwrap_or("")
        && expected.input == found.input
        && expected.output == found.output
        && expected.attribute == found.attribute
}

#[cfg(test)]
mod tests;
