//! The fit loop: tiles, loss and gradient, Adam.

use crate::backend::Backend;
use crate::divergence_guard::Guard;
use crate::model::Corrector;
use crate::preset::{Denominator, LARGEST_RATE, Rate, Sampling, Settings, Start};
use crate::tiles::Schedule;
use burn::optim::AdamConfig;
use sspc_core::objective::{self, Objective, Workspaces};
use sspc_core::prepare::Prepared;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_kernels::features::RADIANCE;
use sspc_kernels::gc::Taps;
use sspc_kernels::network::Network;
use sspc_kernels::simd::Isa;
use std::time::{Duration, Instant};

/// What the caller decides beside the settings.
#[derive(Clone, Debug, Default)]
pub struct Limits {
    /// Steps instead of the preset's.
    pub steps: Option<usize>,
    /// Training ends after the step during which this much time has passed.
    pub time: Option<Duration>,
}

impl Limits {
    /// Share of the time limit that is over, 0 without one. It moves the rate schedule on, so that
    /// training ends at a low rate whichever limit ends it; the result then depends on the clock.
    fn elapsed_share(&self, start: Instant) -> f64 {
        self.time.map_or(0.0, |limit| start.elapsed().as_secs_f64() / limit.as_secs_f64())
    }
}

/// One step, as told to the observer.
#[derive(Clone, Copy, Debug, serde::Serialize)]
pub struct StepRecord {
    /// From 1.
    pub step: usize,
    /// Steps that were planned.
    pub of: usize,
    /// Mean loss of the step's tiles.
    pub loss: f64,
    /// Learning rate.
    pub rate: f64,
    /// Seconds from the start of training to the end of the step.
    pub seconds: f64,
}

/// Whether to go on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Control {
    /// The next step.
    Continue,
    /// No more steps.
    Stop,
}

/// Why training ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum End {
    /// Every planned step was taken.
    AllSteps,
    /// The time was over.
    TimeLimit,
    /// It was told to stop.
    Interrupted,
}

/// A fitted network and how it came about.
#[derive(Clone, Debug)]
pub struct Fitted {
    /// The network.
    pub network: Network,
    /// Every step.
    pub history: Vec<StepRecord>,
    /// Steps that were planned.
    pub planned: usize,
    /// Steps whose loss, gradient or weights were not finite: their update was left out.
    pub dropped: usize,
    /// Why training ended.
    pub end: End,
    /// Wall-clock seconds of training.
    pub seconds: f64,
}

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

/// The objective of one frame under `settings`.
pub fn objective(prepared: &Prepared, settings: &Settings) -> Objective {
    objective_of(prepared, prepared, settings)
}

/// The same of a variant of the frame `base`, by whose z errors are weighed.
fn objective_of(prepared: &Prepared, base: &Prepared, settings: &Settings) -> Objective {
    let paper = Objective::new(prepared, settings.form, Taps::square(settings.radius), prepared.set);
    let weighed = match settings.denominator {
        Denominator::OtherHalf => paper,
        Denominator::OwnHalf => paper.with_own_weight(base),
    };
    let weighed = weighed.with_differences(base);
    if settings.leaves_pixels_out(prepared.height(), prepared.width()) { weighed.without_held_out() } else { weighed }
}

/// `factor` · √mean((y^a - y^b)² / 4), the paper's learning rate from the frame's noise, at most 0.1.
pub fn noise_scaled_rate(factor: f64, prepared: &[&Prepared]) -> f64 {
    let (mut sum, mut count) = (0.0, 0.0);
    for p in prepared {
        for k in RADIANCE..RADIANCE + 3 {
            let pairs = p.halves[0].plane(k).iter().zip(p.halves[1].plane(k)).enumerate();
            for (_, (a, b)) in pairs.filter(|(i, _)| p.is_valid(*i)) {
                sum += (f64::from(*a) - f64::from(*b)).powi(2) / 4.0;
                count += 1.0;
            }
        }
    }
    (factor * f64::sqrt(sum / f64::max(count, 1.0))).min(LARGEST_RATE)
}

/// The rate at `step` (from 0), when this share of the training is `done`.
fn rate_at(settings: &Settings, noise_rate: f64, step: usize, done: f64) -> f64 {
    match settings.rate {
        Rate::NoiseScaled { .. } => noise_rate,
        Rate::Cosine { peak, warm_up } => {
            let warm = ((step + 1) as f64 / warm_up.max(1) as f64).min(1.0);
            let cosine = 0.5 * (1.0 + (std::f64::consts::PI * done).cos());
            peak * warm * cosine
        }
    }
}

fn schedule(settings: &Settings, prepared: &Prepared, frame: usize, steps: Option<usize>) -> Schedule {
    let schedule = Schedule::new(settings, &prepared.plan, prepared.height(), prepared.width(), steps);
    schedule.of_frame(frame).by_importance(settings, prepared)
}

/// Power of the number of frames that the steps grow by. (Eight frames with their neighbours: relL2 over the denoiser's .735
/// at 0.5, .718 at 0.75, .700 at 1.)
const STEPS_GROWTH: f64 = 0.75;

/// Steps over several frames, from those of one: fewer for each, the more there are.
fn steps_of_shot(of_one: usize, frames: usize, settings: &Settings, limits: &Limits) -> usize {
    // Epochs of a grid are counted by the frame, and a user's number is a number.
    if limits.steps.is_some() || matches!(settings.sampling, Sampling::Grid { .. }) {
        return of_one;
    }
    (of_one as f64 * (frames.max(1) as f64).powf(STEPS_GROWTH)).ceil() as usize
}

/// Fits `initial` to one frame, or to several in turn. `observe` is told of every step and may end
/// training; the network so far is returned then.
pub fn fit(
    prepared: &[&Prepared],
    settings: &Settings,
    initial: Network,
    limits: &Limits,
    backend: Backend,
    isa: Isa,
    observe: impl FnMut(&StepRecord) -> Control,
) -> Fitted {
    fit_variant(prepared, prepared, settings, initial, limits, backend, isa, observe)
}

/// The same of frames that have a variant in the place of z; `bases` are these frames with z itself.
#[expect(clippy::too_many_arguments, reason = "those of `fit`, and one")]
pub(crate) fn fit_variant(
    prepared: &[&Prepared],
    bases: &[&Prepared],
    settings: &Settings,
    initial: Network,
    limits: &Limits,
    backend: Backend,
    isa: Isa,
    mut observe: impl FnMut(&StepRecord) -> Control,
) -> Fitted {
    let start = Instant::now();
    let mut objectives: Vec<_> = prepared.iter().zip(bases).map(|(p, base)| objective_of(p, base, settings)).collect();
    let of_frame = |(frame, p): (usize, &&Prepared)| schedule(settings, p, frame, limits.steps);
    let mut schedules: Vec<Schedule> = prepared.iter().enumerate().map(of_frame).collect();
    // Frames in turn; one without any noise has nothing to teach.
    let taught: Vec<usize> = (0..schedules.len()).filter(|&i| schedules[i].steps() > 0).collect();
    let noise_rate = match settings.rate {
        Rate::NoiseScaled { factor } => noise_scaled_rate(factor, prepared),
        Rate::Cosine { .. } => 0.0,
    };
    // The paper's rate is zero where both halves are equal: no step would change a weight.
    let moves = matches!(settings.rate, Rate::Cosine { .. }) || noise_rate > 0.0;
    let of_one = schedules.iter().map(Schedule::steps).max().unwrap_or(0);
    let steps = if moves { steps_of_shot(of_one, taught.len(), settings, limits) } else { 0 };
    let shape = initial.shape;
    let mut model = Corrector::new(&initial, backend);
    let mut guard = Guard::new(&model);
    let workspaces = Workspaces::default();
    let adam = AdamConfig::new().with_epsilon(1e-8);
    let mut optimiser = adam.init();
    let (mut history, mut end) = (Vec::new(), End::AllSteps);
    for step in 0..steps {
        let frame = taught[step % taught.len()];
        let tiles = schedules[frame].next_batch();
        let done = (step as f64 / steps as f64).max(limits.elapsed_share(start)).min(1.0);
        let radius = settings.radius_at(done);
        if objectives[frame].taps.radius() != radius {
            objectives[frame].taps = Taps::square(radius);
        }
        let (influence, frozen_outputs) = (settings.influence.at(done), settings.combination.frozen_outputs());
        let of_tiles = objective::Step { objective: &objectives[frame], shape, isa, influence, frozen_outputs };
        let (loss, gradient) = of_tiles.run(&model.to_vec(), &tiles, &workspaces);
        let rate = guard.brake() * rate_at(settings, noise_rate, step, done);
        if guard.allows(loss, &gradient) {
            guard.took(&model, loss);
            let gradients = model.gradients(gradient);
            model = optimiser.step(rate, model, gradients);
            if !guard.is_sound(&model) {
                // The moments are as bad as the weights that they made.
                optimiser = adam.init();
                model = guard.drop_step();
            }
        } else {
            model = guard.drop_step();
        }
        let seconds = start.elapsed().as_secs_f64();
        history.push(StepRecord { step: step + 1, of: steps, loss, rate, seconds });
        if observe(&history[step]) == Control::Stop {
            end = End::Interrupted;
            break;
        }
        if limits.time.is_some_and(|limit| start.elapsed() >= limit) && step + 1 < steps {
            end = End::TimeLimit;
            break;
        }
    }
    let dropped = guard.dropped();
    let weights = guard.finish(model).to_vec();
    let network = Network { shape, weights };
    Fitted { network, history, planned: steps, dropped, end, seconds: start.elapsed().as_secs_f64() }
}
