//! The loss over both denominators, and its gradient by μ̂.
//!
//! The loss kernel judges what g_c makes of a tile. With no taps but the centre g_c is y, so y of the
//! half stands in for a given μ̂; and in the gated form at s = 1/2 the gradient of the gate's output is
//! that of the loss by μ̂ times (y - z) / 4, so a z that differs from y in one channel reads it off.
//! In the two other channels μ̂ is then compared with itself, or the rounding of y - z there would be
//! multiplied by their gradients.

use sspc_core::objective::{HalfObjective, Objective, PixelLoss, RELATIVE_FLOOR, Tile, relative_weight};
use sspc_image::Image;
use sspc_kernels::features::{DENOISED, FEATURE_CHANNELS, FeatureSet, RADIANCE};
use sspc_kernels::gc::Taps;
use sspc_kernels::parameters::{Form, GATE};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::FeaturePlanes;
use sspc_testkit::case::{Array, Case};
use sspc_testkit::closeness::{MUST_CATCH, Relative, assert_close, assert_sensitive, compare, largest};
use sspc_testkit::kernels::loss_of_tiles;
use std::sync::Arc;

/// One mean of positive terms, summed in f64.
const LOSS: f64 = 1e-6;
/// Of the largest gradient of the case; differences μ̂ - y of one rounding each.
const GRADIENT: f64 = 1e-5;

/// Features of which only y and z are set.
fn features(radiance: &Array, denoised: &Array) -> Image {
    let (height, width) = (radiance.shape[1], radiance.shape[2]);
    let mut image = Image::zeros(FEATURE_CHANNELS, height, width);
    for (first, source) in [(RADIANCE, radiance), (DENOISED, denoised)] {
        for (k, plane) in source.f32().chunks_exact(height * width).enumerate() {
            image.plane_mut(first + k).copy_from_slice(plane);
        }
    }
    image
}

/// One half: y and z of the half itself, what it is compared with, and what the denominator is of.
fn half(radiance: &Array, denoised: &Array, target: &Array, guide: &Array) -> HalfObjective {
    let features_of_half = features(radiance, denoised);
    let (height, width) = (features_of_half.height(), features_of_half.width());
    HalfObjective {
        planes: FeaturePlanes::new(Arc::new(features_of_half), None, FeatureSet::ALL, 0),
        target: Image::from_planes(3, height, width, target.f32()),
        weight: relative_weight(&features(target, guide), None, RELATIVE_FLOOR),
        differences: None,
    }
}

struct Setup {
    case: Case,
    shape: [usize; 3],
}

impl Setup {
    fn new(case: Case) -> Self {
        let (height, width) = case.size("mu_hat_a");
        Self { case, shape: [3, height, width] }
    }

    fn get(&self, key: &str) -> &Array {
        self.case.get(key, &self.shape)
    }

    fn tiles(&self) -> [Tile; 2] {
        let region = Region { top: 0, left: 0, height: self.shape[1], width: self.shape[2] };
        [0, 1].map(|half| Tile::upright(half, region))
    }

    /// The mean over pixels, channels and halves.
    fn measure(&self) -> PixelLoss {
        PixelLoss { scale: 1.0 / (2 * 3 * self.shape[1] * self.shape[2]) as f32, influence: f32::INFINITY }
    }

    /// The objective whose halves `given` makes of μ̂ and of the other half's y: own y, own z, target.
    fn objective(&self, guide: &str, form: Form, given: impl Fn(&Array, &Array) -> [Array; 3]) -> Objective {
        let half = |own: &str, other: &str| {
            let noisy = self.get(&format!("noisy_{other}"));
            let [radiance, denoised, target] = given(self.get(&format!("mu_hat_{own}")), noisy);
            half(&radiance, &denoised, &target, self.get(&format!("{guide}_{other}")))
        };
        Objective { form, taps: Taps::from_offsets(Vec::new()), halves: [half("a", "b"), half("b", "a")] }
    }

    fn loss(&self, isa: Isa, objective: &Objective) -> f64 {
        let outputs = vec![0.0; 2 * 15 * self.shape[1] * self.shape[2]];
        loss_of_tiles(objective, isa, &self.tiles(), &outputs, self.measure()).0
    }

    /// Gradient of the loss by channel `channel` of both halves' μ̂, `[2, H, W]`.
    fn gradient(&self, isa: Isa, guide: &str, channel: usize) -> Vec<f32> {
        let pixels = self.shape[1] * self.shape[2];
        let plane = channel * pixels..(channel + 1) * pixels;
        // μ̂ = (y + z) / 2 with y = 3/2 μ̂ and z = 1/2 μ̂ in this channel: y - z = μ̂.
        let objective = self.objective(guide, Form::Gated, |mu_hat, noisy| {
            let [mut radiance, mut denoised, mut target] = [(); 3].map(|()| mu_hat.clone());
            radiance.values[plane.clone()].iter_mut().for_each(|v| *v *= 1.5);
            denoised.values[plane.clone()].iter_mut().for_each(|v| *v *= 0.5);
            target.values[plane.clone()].copy_from_slice(&noisy.values[plane.clone()]);
            [radiance, denoised, target]
        });
        let outputs = vec![0.0; 2 * 16 * pixels];
        let (_, gradient) = loss_of_tiles(&objective, isa, &self.tiles(), &outputs, self.measure());
        let mu_hat = ["mu_hat_a", "mu_hat_b"].map(|key| self.get(key).values[plane.clone()].to_vec()).concat();
        let gate = gradient.chunks_exact(16 * pixels).flat_map(|half| &half[GATE * pixels..]);
        gate.zip(mu_hat).map(|(g, mu_hat)| (f64::from(*g) * 4.0 / mu_hat) as f32).collect()
    }
}

#[test]
fn loss_matches_over_both_denominators() {
    for case in Case::of_kind("loss") {
        let setup = Setup::new(case);
        for guide in ["denoised", "noisy"] {
            let expected = setup.case.get(&format!("loss_over_{guide}"), &[1]).values[0];
            for isa in Isa::available() {
                let stage = format!("{} {} over {guide}", setup.case.name, isa.name());
                let mut objective = setup
                    .objective(guide, Form::Paper, |mu_hat, noisy| [mu_hat.clone(), mu_hat.clone(), noisy.clone()]);
                let error = (setup.loss(isa, &objective) / expected - 1.0).abs();
                assert!(error <= LOSS, "{stage}: expected {expected:.9e}, relative error {error:.2e}");
                println!("{stage}: relative error {error:.1e}");

                // The 0.01 of the denominator, wrong by a thousandth.
                for half in &mut objective.halves {
                    for weight in half.weight.data_mut() {
                        *weight = 1.0 / (1.0 / *weight + MUST_CATCH as f32 * RELATIVE_FLOOR);
                    }
                }
                let error = (setup.loss(isa, &objective) / expected - 1.0).abs();
                assert!(error > LOSS, "{stage}: an error of {MUST_CATCH} in the denominator's floor goes unnoticed");
            }
        }
    }
}

#[test]
fn loss_gradients_match_over_both_denominators() {
    for case in Case::of_kind("loss") {
        let setup = Setup::new(case);
        let [_, height, width] = setup.shape;
        for guide in ["denoised", "noisy"] {
            let by = |half: &str| setup.get(&format!("d_mu_hat_{half}_over_{guide}"));
            for isa in Isa::available() {
                for channel in 0..3 {
                    let stage =
                        format!("{} {} over {guide}, d_mu_hat of channel {channel}", setup.case.name, isa.name());
                    let values = ["a", "b"].map(|half| by(half).slab(channel, channel + 1).values).concat();
                    let expected = Array { shape: vec![2, height, width], values };
                    let found = setup.gradient(isa, guide, channel);
                    let worst =
                        assert_close(&stage, &expected, &found, Relative::ToScale(largest(&expected)), GRADIENT);
                    println!("{stage}: worst {:.1e}", worst.0);
                    assert_sensitive(&stage, |error| {
                        let scaled: Vec<f32> = found.iter().map(|g| g * (1.0 + error as f32)).collect();
                        compare("perturbed", &expected, &scaled, Relative::ToScale(largest(&expected)), GRADIENT)
                            .is_err()
                    });
                }
            }
        }
    }
}
