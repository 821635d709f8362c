//! Which combination function is trained: g_c, or f_c of Deep Combiner as its special case.
//!
//! f_c is g_c with β^z = 1 and β^ρ = β^n = 0 at every pixel. Its model is an ordinary one: the rows of
//! the last layer that belong to the slopes hold no weights, and biases whose activations are these
//! numbers exactly. Their gradient is held at zero, so Adam never moves them, and nothing flows
//! through them to the layers below.

use sspc_kernels::network::{KERNEL, Network};
use sspc_kernels::parameters::{DENOISED_SLOPES, SLOPE_COUNT, SLOPES};
use std::ops::Range;

/// tanh of this is 1 in f32: the difference, 2 e^-40, is far below half a unit in the last place.
const SATURATED: f32 = 20.0;

/// A combination function.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub enum Combination {
    /// g_c (Eq. 10): the network says all slopes.
    #[serde(rename = "gc")]
    PostCorrection,
    /// f_c (Back et al. 2020): β^z = 1, β^ρ = β^n = 0.
    #[serde(rename = "fc")]
    DeepCombiner,
}

impl Combination {
    /// Makes `network` one of this function.
    pub fn fix(self, network: &mut Network) {
        if self == Combination::PostCorrection {
            return;
        }
        let last = network.shape.layers - 1;
        let (inputs, outputs) = network.shape.channels(last);
        let start = network.shape.layer_start(last);
        let kernel = inputs * KERNEL * KERNEL;
        let (kernels, biases) = network.weights[start..].split_at_mut(outputs * kernel);
        kernels[SLOPES * kernel..(SLOPES + SLOPE_COUNT) * kernel].fill(0.0);
        let (denoised, others) = biases[SLOPES..SLOPES + SLOPE_COUNT].split_at_mut(DENOISED_SLOPES);
        denoised.fill(SATURATED);
        others.fill(0.0);
    }

    /// Network outputs that stay as they are: nothing flows back through them.
    pub fn frozen_outputs(self) -> Range<usize> {
        match self {
            Combination::PostCorrection => 0..0,
            Combination::DeepCombiner => SLOPES..SLOPES + SLOPE_COUNT,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::backend::Backend;
    use crate::fit::{Control, Limits, fit};
    use crate::preset::{Preset, Settings};
    use sspc_core::rng::Rng;
    use sspc_core::start;
    use sspc_kernels::network::WindowNetwork;
    use sspc_kernels::simd::Isa;
    use sspc_testkit::frames::{prepared, textured};
    use sspc_testkit::method::parameters;

    /// Fails when any gradient reaches the slopes' rows: Adam would move them by about the rate.
    #[test]
    fn the_slopes_of_f_c_are_one_and_zero_after_training() {
        let rng = &mut Rng::new(7);
        let frame = prepared(textured(20, 23, rng));
        let settings = Settings {
            combination: Combination::DeepCombiner,
            tile: 16,
            batch: 2,
            ..Settings::of(Preset::Balanced, 1)
        };
        let mut initial = start::analytic(settings.shape, 0.7, rng);
        settings.combination.fix(&mut initial);
        let limits = Limits { steps: Some(6), time: None };
        let observe = |_: &_| Control::Continue;
        let fitted = fit(&[&frame], &settings, initial.clone(), &limits, Backend::Flex, Isa::best(), observe);
        let moved = initial.weights.iter().zip(&fitted.network.weights).filter(|(a, b)| a != b).count();
        assert!(moved > initial.weights.len() / 2, "only {moved} of {} weights were trained", initial.weights.len());
        for isa in Isa::available() {
            let network = WindowNetwork::new(isa, settings.form, &fitted.network);
            let planes = parameters(&network, &frame.halves[0]);
            for slope in SLOPES..SLOPES + SLOPE_COUNT {
                let expected = if slope < DENOISED_SLOPES { 1.0 } else { 0.0 };
                assert!(planes.plane(slope).iter().all(|v| *v == expected), "{}: slope {slope}", isa.name());
            }
            assert!(planes.plane(SLOPE_COUNT).iter().any(|v| *v != planes.plane(SLOPE_COUNT)[0]), "bandwidths vary");
        }
    }
}
