//! Writes both graphs of a network of made-up weights: `write_graphs FOLDER [paper|gated]`. Other
//! engines' tests run them.

use sspc_core::parameters::Form;
use sspc_onnx::{Contract, Model, write_image, write_network};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = std::path::PathBuf::from(arguments.next().ok_or("which folder?")?);
    let form = match arguments.next().as_deref() {
        Some("paper") => Form::Paper,
        _ => Form::Gated,
    };
    let count = Contract::new(form).shape.parameter_count();
    // A fixed sequence in -0.25..0.25: deep enough signals without a random generator.
    let weights = (0..count).map(|i| ((i * 7919 + 13) % 1009) as f32 / 2018.0 - 0.25).collect();
    let model = Model::new(Contract::new(form), weights)?;
    std::fs::write(folder.join("network.onnx"), write_network(&model))?;
    std::fs::write(folder.join("image.onnx"), write_image(&model))?;
    Ok(())
}
