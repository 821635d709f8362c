//! Writes the graphs of an untrained model: `write_graphs FOLDER [paper|gated]`. The gated model adds a smoothed residual
//! to the denoiser's picture and is usable as it is; the paper's has random weights.

use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model, write_image, write_network, write_operators, write_picture};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = std::path::PathBuf::from(arguments.next().ok_or("which folder?")?);
    let paper = arguments.next().as_deref() == Some("paper");
    let form = if paper { Form::Paper } else { Form::Gated };
    let contract = Contract::new(form);
    let mut rng = Rng::new(1);
    let network = match form {
        Form::Paper => start::paper(contract.shape, &mut rng),
        Form::Gated => start::analytic(contract.shape, 0.7, &mut rng),
    };
    let model = Model::new(contract, network.weights)?;
    std::fs::write(folder.join("network.onnx"), write_network(&model))?;
    std::fs::write(folder.join("image.onnx"), write_image(&model))?;
    std::fs::write(folder.join("picture.onnx"), write_picture(&model))?;
    std::fs::write(folder.join("operators.onnx"), write_operators(&model))?;
    Ok(())
}
