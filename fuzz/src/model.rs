//! Model files: what is accepted means exactly what this program computes, and nothing else is accepted.

use super::assert_one_line;
use sspc_onnx::{GraphKind, read_graph_kind, read_model, write_image, write_network, write_operators, write_picture};

/// Reads the bytes; whether they are a model.
pub fn read(bytes: &[u8]) -> bool {
    let kind = read_graph_kind(bytes).inspect_err(|error| assert_one_line(error));
    let model = match read_model(bytes) {
        Ok(model) => model,
        Err(error) => {
            assert_one_line(&error);
            return false;
        }
    };
    assert!(model.weights.iter().all(|weight| weight.is_finite()));
    assert_eq!(model.weights.len(), model.contract.shape.parameter_count());
    let written = match kind.expect("a model has a kind") {
        GraphKind::Network => write_network(&model),
        GraphKind::Image => write_image(&model),
        GraphKind::Picture => write_picture(&model),
        GraphKind::Operators => write_operators(&model),
    };
    assert_eq!(read_model(&written).expect("what was written can be read"), model);
    true
}
