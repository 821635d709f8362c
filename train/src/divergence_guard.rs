//! Keeps training finite: which steps are taken, what to come back to from a bad one, and the weights
//! that were best.

use crate::model::Corrector;

/// Adam squares the gradient in f32: from 1.8e19 on the square is infinite, and the weight would never
/// move again.
const LARGEST_GRADIENT: f32 = 1e18;
/// The rate after a dropped step, times the rate before.
const BRAKE: f64 = 0.5;
/// Steps over which the loss is averaged to tell better weights from worse: tiles differ.
const SMOOTHED_STEPS: f64 = 20.0;
/// A mean loss this many times the lowest one is not the scatter of tiles: training has left good
/// weights behind.
const LOST: f64 = 10.0;

/// Watches one fit.
pub struct Guard {
    /// The last weights that gave a finite loss and gradient.
    good: Corrector,
    /// The weights where the smoothed loss was lowest.
    best: Corrector,
    /// Logarithms of the loss, smoothed (so that no single bright tile decides), now and at `best`.
    now: Option<f64>,
    lowest: f64,
    brake: f64,
    dropped: usize,
}

impl Guard {
    /// A guard of training that starts from `model`.
    pub fn new(model: &Corrector) -> Self {
        Self { good: model.clone(), best: model.clone(), now: None, lowest: f64::INFINITY, brake: 1.0, dropped: 0 }
    }

    /// What the schedule's rate is multiplied by: 1, halved by every dropped step.
    pub fn brake(&self) -> f64 {
        self.brake
    }

    /// Steps that were not taken.
    pub fn dropped(&self) -> usize {
        self.dropped
    }

    /// Whether a step may be taken with this loss and gradient.
    pub fn allows(&self, loss: f64, gradient: &[f32]) -> bool {
        // A comparison that is false for NaN.
        loss.is_finite() && !gradient.is_empty() && gradient.iter().all(|g| g.abs() <= LARGEST_GRADIENT)
    }

    /// Whether every weight is finite.
    pub fn is_sound(&self, model: &Corrector) -> bool {
        model.to_vec().iter().all(|weight| weight.is_finite())
    }

    /// Notes that a step is taken from `model`, whose tiles had this mean loss.
    pub fn took(&mut self, model: &Corrector, loss: f64) {
        let log = loss.max(f64::MIN_POSITIVE).ln();
        let smoothed = self.now.map_or(log, |now| now + (log - now) / SMOOTHED_STEPS);
        self.now = Some(smoothed);
        if smoothed <= self.lowest {
            self.lowest = smoothed;
            self.best = model.clone();
        }
        self.good = model.clone();
    }

    /// Notes that a step is not taken; gives the weights to go on from, more slowly.
    pub fn drop_step(&mut self) -> Corrector {
        self.dropped += 1;
        self.brake *= BRAKE;
        self.good.clone()
    }

    /// The weights to keep: `model`, or the best where training has gone astray since.
    pub fn finish(self, model: Corrector) -> Corrector {
        let astray = self.now.is_some_and(|now| now > self.lowest + LOST.ln());
        if astray { self.best } else { model }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::Backend;
    use sspc_kernels::network::{Network, Shape};
    use sspc_kernels::parameters::Form;

    fn model(value: f32) -> Corrector {
        let shape = Shape { hidden: 1, layers: 1, outputs: Form::Paper.parameters() };
        let weights = vec![value; shape.parameter_count()];
        Corrector::new(&Network { shape, weights }, Backend::Flex)
    }

    #[test]
    fn steps_that_would_spoil_the_weights_are_dropped() {
        let mut guard = Guard::new(&model(1.0));
        assert!(guard.allows(0.5, &[1.0, -1e18]));
        for (loss, gradient) in [
            (f64::NAN, vec![1.0]),
            (f64::INFINITY, vec![1.0]),
            (0.5, vec![1.0, f32::NAN]),
            (0.5, vec![-2e19]),
            (0.5, vec![]),
        ] {
            assert!(!guard.allows(loss, &gradient), "{loss} {gradient:?}");
        }
        guard.took(&model(2.0), 0.5);
        assert!(guard.is_sound(&model(2.0)) && !guard.is_sound(&model(f32::INFINITY)));
        assert_eq!(guard.drop_step().to_vec()[0], 2.0);
        assert_eq!((guard.dropped(), guard.brake()), (1, 0.5));
    }

    #[test]
    fn the_best_weights_are_kept_when_training_goes_astray() {
        let fitted = |losses: &[f64]| {
            let mut guard = Guard::new(&model(0.0));
            losses.iter().enumerate().for_each(|(step, loss)| guard.took(&model(step as f32), *loss));
            guard.finish(model(-1.0)).to_vec()[0]
        };
        let falling: Vec<f64> = (0..60).map(|step| 1.0 / (1.0 + step as f64)).collect();
        assert_eq!(fitted(&falling), -1.0);
        // One bright tile is no divergence, sixty steps of a thousandfold loss are.
        let bright: Vec<f64> = falling.iter().copied().chain([1e3]).collect();
        assert_eq!(fitted(&bright), -1.0);
        let astray: Vec<f64> = falling.iter().copied().chain([1e3; 60]).collect();
        assert_eq!(fitted(&astray), 59.0);
    }
}
