//! One fit for each variant of z: the corrections of networks that start from different denoisers' pictures err in
//! different places, and their mean errs less than any of them.

use crate::backend::Backend;
use crate::fit::{Control, End, Fitted, Limits, StepRecord, fit_variant, starting_network};
use crate::preset::Settings;
use sspc_core::prepare::Prepared;
use sspc_kernels::network::Network;
use sspc_kernels::simd::Isa;
use std::borrow::Cow;
use std::time::{Duration, Instant};

/// The fitted networks of a model and how they came about.
#[derive(Clone, Debug)]
pub struct Fits {
    /// One for each variant of z, in their order.
    pub networks: Vec<Network>,
    /// Every step of every fit, one after another.
    pub history: Vec<StepRecord>,
    /// Steps that were planned, of all fits.
    pub planned: usize,
    /// Steps that were left out ([`Fitted::dropped`]).
    pub dropped: usize,
    /// Why training ended.
    pub end: End,
    /// Wall-clock seconds of training.
    pub seconds: f64,
}

/// The networks that training of `settings` starts from, one for each of so many variants.
pub fn starting_networks(settings: &Settings, count: usize) -> Vec<Network> {
    (0..count).map(|k| starting_network(&of_network(settings, k))).collect()
}

/// The settings of fit `k`: weights and tiles of its own.
fn of_network(settings: &Settings, k: usize) -> Settings {
    // The first is that of a frame without variants.
    let seed = settings.seed ^ (k as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    Settings { seed, ..settings.clone() }
}

/// Fits a network for each variant of z of frames that have as many variants as there are `initial` networks. A time
/// limit is shared out evenly. `observe` may end training; networks that were not begun stay as they are.
pub fn fit_variants(
    prepared: &[&Prepared],
    settings: &Settings,
    initial: Vec<Network>,
    limits: &Limits,
    backend: Backend,
    isa: Isa,
    mut observe: impl FnMut(&StepRecord) -> Control,
) -> Fits {
    let start = Instant::now();
    let count = initial.len();
    let nothing =
        Fits { networks: Vec::new(), history: Vec::new(), planned: 0, dropped: 0, end: End::AllSteps, seconds: 0.0 };
    let mut fits = initial.into_iter().enumerate().fold(nothing, |mut fits, (k, network)| {
        if fits.end == End::Interrupted {
            fits.networks.push(network);
            return fits;
        }
        let of_variant: Vec<Cow<Prepared>> = prepared.iter().map(|p| p.of_variant(k)).collect();
        let frames: Vec<&Prepared> = of_variant.iter().map(|p| &**p).collect();
        let before = fits.history.len();
        let share = |limit: Duration| limit.saturating_sub(start.elapsed()) / (count - k) as u32;
        let limits = Limits { time: limits.time.map(share), ..limits.clone() };
        let Fitted { network, history, planned, dropped, end, .. } =
            fit_variant(&frames, prepared, &of_network(settings, k), network, &limits, backend, isa, |step| {
                let of = before + (count - k) * step.of;
                observe(&StepRecord { step: before + step.step, of, seconds: start.elapsed().as_secs_f64(), ..*step })
            });
        let told =
            |step: StepRecord| StepRecord { step: before + step.step, of: before + (count - k) * step.of, ..step };
        fits.history.extend(history.into_iter().map(told));
        fits.networks.push(network);
        fits.planned += planned;
        fits.dropped += dropped;
        fits.end = if end == End::AllSteps { fits.end } else { end };
        fits
    });
    fits.seconds = start.elapsed().as_secs_f64();
    fits
}
