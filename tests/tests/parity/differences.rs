//! Differences of a correction: their weights, the loss, and its gradient by μ̂ with and without a limit.

use sspc_core::differences::Differences;
use sspc_core::objective::DifferenceTarget;
use sspc_image::Image;
use sspc_kernels::features::{DENOISED, FEATURE_CHANNELS, RADIANCE};
use sspc_kernels::loss::{self, SelfSupervised};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_testkit::case::{Array, Case};
use sspc_testkit::closeness::{Relative, assert_close, assert_sensitive, compare, largest};
use sspc_testkit::frames::prepared;

/// Sums of 72 squares in f32, and a square of their ratio.
const WEIGHT: f64 = 1e-5;
/// One mean of positive terms, summed in f64.
const LOSS: f64 = 1e-6;
/// Of the largest gradient of the case; a sum of up to five terms of one rounding each.
const GRADIENT: f64 = 1e-5;

struct Setup {
    case: Case,
    height: usize,
    width: usize,
}

impl Setup {
    fn new(case: Case) -> Self {
        let (height, width) = case.size("mu_hat");
        Self { case, height, width }
    }

    fn image(&self, key: &str, channels: usize) -> Image {
        self.case.get(key, &[channels, self.height, self.width]).image(0)
    }

    fn expected_weight(&self) -> &Array {
        self.case.get("difference_weight", &[2, self.height, self.width])
    }

    /// Weights of the differences of half a.
    fn target(&self, noisy: [Image; 2]) -> DifferenceTarget {
        let (height, width) = (self.height, self.width);
        let halves = noisy.map(|y| {
            Image::from_fn(FEATURE_CHANNELS, height, width, |c, row, x| match c {
                RADIANCE..3 => y.at(c, row, x),
                DENOISED.. => 0.5,
                _ => 0.0,
            })
        });
        let known = Image::from_fn(2, height, width, |axis, y, x| {
            if (axis == 0 && x + 1 < width) || (axis == 1 && y + 1 < height) { 1.0 } else { 0.0 }
        });
        let read = ["given_a", "given_b"].map(|key| self.image(key, 6));
        let given = Differences::of_known(read, known, &prepared(halves), 1.0);
        DifferenceTarget::new(&given, 0, &self.image("weight", 1))
    }

    fn noisy(&self) -> [Image; 2] {
        ["noisy_a", "noisy_b"].map(|key| self.image(key, 3))
    }

    /// The loss and its gradient by μ̂, differences compared with `given`.
    fn loss(&self, isa: Isa, given: &Image, influence: f32) -> (f64, Vec<f32>) {
        let (target, weight) = (self.image("noisy_b", 3), self.image("weight", 1));
        let differences_weight = self.expected_weight().image(0);
        let region = Region::whole(self.height, self.width);
        let scale = 1.0 / (3 * region.pixels()) as f32;
        let mut judge =
            SelfSupervised { target: &target, weight: &weight, region, scale, influence, squares: Vec::new() };
        let corrected = self.image("mu_hat", 3).into_data();
        let mut gradient = vec![0.0; corrected.len()];
        let differences = loss::Differences { target: given, weight: &differences_weight };
        judge.of_tile(isa, differences, &corrected, &mut gradient);
        (judge.squares.iter().sum::<f64>() * f64::from(scale), gradient)
    }
}

#[test]
fn weights_match_and_depend_on_the_noise_around() {
    for setup in Case::of_kind("differences").into_iter().map(Setup::new) {
        let expected = setup.expected_weight();
        let relative = Relative::ToScale(largest(expected));
        let found = setup.target(setup.noisy());
        let worst = assert_close(&setup.case.name, expected, found.weight.data(), relative, WEIGHT);
        println!("{}: worst {:.1e}", setup.case.name, worst.0);
        assert_sensitive(&setup.case.name, |error| {
            let [mut a, b] = setup.noisy();
            a.data_mut().iter_mut().for_each(|v| *v *= 1.0 + error as f32);
            let moved = setup.target([a, b]);
            compare("perturbed", expected, moved.weight.data(), relative, WEIGHT).is_err()
        });
    }
}

#[test]
fn loss_and_gradient_match_with_and_without_a_limit() {
    for setup in Case::of_kind("differences").into_iter().map(Setup::new) {
        let (height, width) = (setup.height, setup.width);
        let limit = setup.case.facts["influence"].as_f64().expect("a limit") as f32;
        let given = setup.image("given_b", 6);
        // The value is that of the plain loss, whatever the limit.
        let loss = setup.case.get("loss", &[1]).values[0];
        for isa in Isa::available() {
            for (key, influence) in [("d_mu_hat", f32::INFINITY), ("d_mu_hat_limited", limit)] {
                let stage = format!("{} {} {key}", setup.case.name, isa.name());
                let expected = setup.case.get(key, &[3, height, width]);
                let relative = Relative::ToScale(largest(expected));
                let (value, gradient) = setup.loss(isa, &given, influence);
                assert!((value / loss - 1.0).abs() <= LOSS, "{stage}: loss {value}, expected {loss}");
                let worst = assert_close(&stage, expected, &gradient, relative, GRADIENT);
                println!("{stage}: worst {:.1e}", worst.0);
                assert_sensitive(&stage, |error| {
                    let mut moved = given.clone();
                    moved.data_mut().iter_mut().for_each(|v| *v *= 1.0 + error as f32);
                    compare("perturbed", expected, &setup.loss(isa, &moved, influence).1, relative, GRADIENT).is_err()
                });
            }
        }
    }
}
