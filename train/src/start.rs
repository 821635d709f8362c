//! Where training starts: random weights, or the analytic start.

use crate::preset::{Settings, Start};
use sspc_core::network::{Network, start};
use sspc_core::rng::Rng;

/// The network that training of `settings` starts from.
pub fn starting_network(settings: &Settings) -> Network {
    let rng = &mut Rng::new(settings.seed);
    let mut network = match settings.start {
        Start::Random => start::paper(settings.shape, rng),
        Start::Analytic { gate } => start::analytic(settings.shape, gate, rng),
    };
    settings.combination.fix(&mut network);
    network
}
