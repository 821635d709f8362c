//! Twenty steps on a small frame, in both forms, on every backend.

use super::train::{Convolutions, Step, train};
use crate::BACKENDS;
use sspc_core::objective::{HalfObjective, Objective, RELATIVE_FLOOR, relative_weight, triple};
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet, RADIANCE};
use sspc_kernels::gc::Taps;
use sspc_kernels::network::{Network, Shape};
use sspc_kernels::parameters::Form;
use sspc_kernels::windows::FeaturePlanes;
use sspc_testkit::case::Case;
use sspc_train::backend::Backend;
use std::sync::Arc;

/// Every step's loss: f32 against f64, after up to 19 updates.
const LOSS: f64 = 1e-3;
/// Distance of the final weights from the reference's over the distance that training moved them.
const WEIGHTS: f64 = 1e-2;

struct Setup {
    case: Case,
    objective: Objective,
    start: Network,
    steps: Vec<Step>,
}

impl Setup {
    fn new(form: Form) -> Self {
        let case = Case::named("training");
        let shape = Shape::paper(form);
        let (height, width) = case.size("features_a");
        let halves = ["features_a", "features_b"].map(|key| {
            let values = case.get(key, &[FEATURE_CHANNELS, height, width]).f32();
            Image::from_planes(FEATURE_CHANNELS, height, width, values)
        });
        let taps = Taps::square(case.count("radius"));
        let half = |own: &Image, other: &Image| HalfObjective {
            planes: FeaturePlanes::new(Arc::new(own.clone()), None, FeatureSet::ALL, taps.radius()),
            target: triple(other, RADIANCE),
            weight: relative_weight(other, None, RELATIVE_FLOOR),
            differences: None,
        };
        let [a, b] = &halves;
        let objective = Objective { form, halves: [half(a, b), half(b, a)], taps: taps.clone() };
        let key = format!("weights_start_{}", form.parameters());
        let start = Network { shape, weights: case.get(&key, &[shape.parameter_count()]).f32() };
        let steps = steps(&case);
        Self { case, objective, start, steps }
    }

    fn train(&self, backend: Backend, convolutions: Convolutions) -> (Vec<f64>, Network) {
        let size = (self.case.count("tile"), self.case.count("tile"));
        let epsilon = self.case.facts["adam"]["epsilon"].as_f64().expect("Adam's epsilon") as f32;
        train(&self.objective, self.start.clone(), size, &self.steps, epsilon, backend, convolutions)
    }

    /// The largest relative error of a step's loss, and the step.
    fn loss_error(&self, losses: &[f64]) -> (f64, usize) {
        let expected = &self.case.get(&format!("losses_{}", self.start.shape.outputs), &[self.steps.len()]).values;
        assert_eq!(losses.len(), expected.len(), "one loss a step");
        let errors = losses.iter().zip(expected).map(|(f, e)| (f / e - 1.0).abs()).zip(1..);
        errors.max_by(|a, b| a.0.total_cmp(&b.0)).expect("steps")
    }

    /// The distance of `weights` from the reference's, over the distance from the start to those.
    fn weight_error(&self, weights: &[f32]) -> f64 {
        let key = format!("weights_end_{}", self.start.shape.outputs);
        let expected = &self.case.get(&key, &[self.start.weights.len()]).values;
        let distance = |weights: &[f32]| {
            weights.iter().zip(expected).map(|(w, e)| (f64::from(*w) - e).powi(2)).sum::<f64>().sqrt()
        };
        distance(weights) / distance(&self.start.weights)
    }
}

/// The case's tiles and rates.
pub fn steps(case: &Case) -> Vec<Step> {
    let Some(&[steps, tiles, 2]) = case.arrays.get("origins").map(|a| a.shape.as_slice()) else {
        panic!("case {}: origins of steps and tiles", case.name)
    };
    let origins = case.get("origins", &[steps, tiles, 2]);
    let rates = case.get("rates", &[steps]);
    let of_step = |values: &[f64]| values.chunks_exact(2).map(|o| (o[0] as usize, o[1] as usize)).collect();
    let pairs = origins.values.chunks_exact(2 * tiles).zip(&rates.values);
    pairs.map(|(values, &rate)| Step { origins: of_step(values), rate }).collect()
}

#[test]
fn twenty_steps_agree_on_every_backend() {
    for form in [Form::Paper, Form::Gated] {
        let setup = Setup::new(form);
        for backend in BACKENDS {
            for convolutions in [Convolutions::Kernels, Convolutions::Burns] {
                let (losses, network) = setup.train(backend, convolutions);
                let ((loss, step), weights) = (setup.loss_error(&losses), setup.weight_error(&network.weights));
                let what = format!("{form:?} {backend} {convolutions:?}");
                println!("{what}: loss off by {loss:.1e} at step {step}, weights by {weights:.1e}");
                assert!(loss <= LOSS, "{what}: loss of step {step} off by {loss:.2e}");
                assert!(weights <= WEIGHTS, "{what}: weights off by {weights:.2e}");
            }
        }
    }
}

/// A rate wrong by a few parts in a hundred, another second moment, or one tile out of place must
/// not pass; which of the two limits catches it is printed.
#[test]
fn a_wrong_rate_or_tile_is_caught() {
    let wrong_rate = |setup: &mut Setup| setup.steps.iter_mut().for_each(|s| s.rate *= 1.02);
    let wrong_tile = |setup: &mut Setup| setup.steps[3].origins[0] = (0, 1);
    let wrong_order = |setup: &mut Setup| setup.steps.swap(4, 5);
    let faults: [(&str, &dyn Fn(&mut Setup)); 3] =
        [("rate", &wrong_rate), ("tile", &wrong_tile), ("order", &wrong_order)];
    for (what, fault) in faults {
        let mut setup = Setup::new(Form::Gated);
        fault(&mut setup);
        let (losses, network) = setup.train(Backend::Flex, Convolutions::Kernels);
        let ((loss, step), weights) = (setup.loss_error(&losses), setup.weight_error(&network.weights));
        println!("wrong {what}: loss off by {loss:.1e} at step {step}, weights by {weights:.1e}");
        assert!(loss > LOSS || weights > WEIGHTS, "a wrong {what} goes unnoticed");
    }
}
