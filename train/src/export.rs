//! `export`: a fitted model as another ONNX graph.

use crate::cli::{ExportArgs, Graph};
use crate::warm_start::read_model;
use sspc_cli::{Code, Failure};
use sspc_frames::atomic::atomic_write_bytes;
use sspc_onnx::{write_image, write_network, write_operators, write_picture};

/// Runs the subcommand.
///
/// # Errors
/// What reading the model and writing the file can raise.
pub fn run(args: &ExportArgs) -> Result<(), Failure> {
    let path = if args.model.is_dir() { args.model.join("model.onnx") } else { args.model.clone() };
    let model = read_model(&path)?;
    if matches!(args.graph, Graph::Picture) && model.contract.differences > 0.0 {
        let message = format!(
            "{}: its correction is judged by differences of y too, and the picture graph has no inputs for them",
            path.display()
        );
        return Err(Failure::new(Code::Input, message, "export the network, or fit without --set differences"));
    }
    let bytes = match args.graph {
        Graph::Network => write_network(&model),
        Graph::Image => write_image(&model),
        Graph::Picture => write_picture(&model),
        Graph::Operators => write_operators(&model),
    };
    Ok(atomic_write_bytes(&args.output, &[path], &bytes)?)
}
