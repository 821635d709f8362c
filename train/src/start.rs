//! Where training starts: random weights, the analytic start, or weights that are built in.
//!
//! The built-in weights were fitted to frames of made-up scenes, rendered by `tests/scenes`; its
//! README has the commands. No frame that figures of this project are measured on was among them.

use crate::preset::{Settings, Start};
use sspc_core::network::{Network, Shape, start};
use sspc_core::parameters::Form;
use sspc_core::rng::Rng;
use sspc_onnx::read_model;

/// A model that `sspc-train fit` wrote.
const BUILT_IN: &[u8] = include_bytes!("start.onnx");

/// The gate of the analytic start.
pub const ANALYTIC_GATE: f64 = 0.7;

/// The network that training of `settings` starts from.
pub fn starting_network(settings: &Settings) -> Network {
    let rng = &mut Rng::new(settings.seed);
    let mut network = match settings.start {
        Start::Random => start::paper(settings.shape, rng),
        Start::Analytic { gate } => start::analytic(settings.shape, gate, rng),
        Start::BuiltIn => built_in(),
    };
    settings.combination.fix(&mut network);
    network
}

/// Whether the built-in weights are those of a network of this shape.
pub fn is_built_in(shape: Shape) -> bool {
    shape == Shape::shallow(Form::Gated)
}

fn built_in() -> Network {
    read_model(BUILT_IN).expect("the built-in start is a model").network()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::Preset;

    #[test]
    fn the_built_in_start_is_a_network_of_the_presets_shape() {
        let network = built_in();
        assert!(is_built_in(network.shape), "{:?}", network.shape);
        assert!(network.weights.iter().all(|w| w.is_finite() && w.abs() < 100.0), "weights of a usual size");
        for preset in [Preset::Fast, Preset::Balanced, Preset::Quality] {
            assert_eq!(starting_network(&Settings::of(preset, 3)), network, "{preset}");
        }
    }
}
