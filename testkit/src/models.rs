//! Made-up models and features that need no file.

use sspc_image::Image;
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model};

/// The next of a fixed sequence in 0..1 (Knuth's multiplier, the upper bits).
pub fn next(state: &mut u64) -> f32 {
    *state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
    (*state >> 40) as f32 / (1u64 << 24) as f32
}

/// Weights of variance 2 / fan-in, so that signals neither vanish nor explode.
///
/// # Panics
/// When no contract has such a network.
pub fn model(form: Form, hidden: usize, layers: usize) -> Model {
    let mut contract = Contract::new(form);
    contract.shape = Shape { hidden, layers, outputs: form.parameters() };
    let mut state = 1;
    let mut weights = Vec::new();
    for l in 0..layers {
        let (inputs, outputs) = contract.shape.channels(l);
        let scale = (24.0 / (9 * inputs) as f32).sqrt();
        weights.extend((0..outputs * inputs * 9).map(|_| (next(&mut state) - 0.5) * scale));
        weights.extend((0..outputs).map(|_| (next(&mut state) - 0.5) * 0.2));
    }
    Model::new(contract, weights).expect("a model")
}

/// Features in 0..2, `[13, height, width]`, without any structure.
pub fn features(height: usize, width: usize) -> Image {
    let mut state = (height * 10007 + width) as u64;
    Image::from_fn(FEATURE_CHANNELS, height, width, |_, _, _| 2.0 * next(&mut state))
}
