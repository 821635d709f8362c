//! Weights before training.

use crate::rng::Rng;
use sspc_kernels::network::{KERNEL, Network, Shape};
use sspc_kernels::parameters::{ACTIVATION_FLOOR, BANDWIDTH_COUNT, BANDWIDTHS, CENTRE, DENOISED_SLOPES, GATE};

/// Parameters of g_c at the analytic start: g_c ≈ z + smoothed (y - z), before any training.
const START_SLOPE_DENOISED: f64 = 0.9;
/// In the order ρ, n, v, y, z.
const START_BANDWIDTHS: [f64; BANDWIDTH_COUNT] = [30.0, 4.0, 1.0, 0.5, 5.0];
const START_CENTRE: f64 = 1.0;
/// The last layer's weights against their usual size, so that biases decide at first.
const START_LAST_LAYER: f32 = 0.1;

/// Glorot and Bengio's uniform initialisation (2010) with zero biases, the paper's start.
pub fn paper(shape: Shape, rng: &mut Rng) -> Network {
    let mut weights = Vec::with_capacity(shape.parameter_count());
    for l in 0..shape.layers {
        let (inputs, outputs) = shape.channels(l);
        let limit = (6.0 / ((inputs + outputs) * KERNEL * KERNEL) as f32).sqrt();
        weights.extend((0..outputs * inputs * KERNEL * KERNEL).map(|_| limit * (2.0 * rng.uniform() - 1.0)));
        weights.extend(std::iter::repeat_n(0.0, outputs));
    }
    Network { shape, weights }
}

/// He et al.'s initialisation (2015) with a last layer so small that its biases decide: they make
/// g_c a smoothed residual on top of z, and the gate, where there is one, `gate`.
pub fn analytic(shape: Shape, gate: f64, rng: &mut Rng) -> Network {
    let mut weights = Vec::with_capacity(shape.parameter_count());
    for l in 0..shape.layers {
        let (inputs, outputs) = shape.channels(l);
        let last = l + 1 == shape.layers;
        let deviation = (2.0 / (inputs * KERNEL * KERNEL) as f32).sqrt() * if last { START_LAST_LAYER } else { 1.0 };
        weights.extend((0..outputs * inputs * KERNEL * KERNEL).map(|_| deviation * rng.normal()));
        weights.extend((0..outputs).map(|o| if last { start_output(o, gate) as f32 } else { 0.0 }));
    }
    Network { shape, weights }
}

/// The output whose activation is the start's parameter `channel`.
fn start_output(channel: usize, gate: f64) -> f64 {
    match channel {
        0..DENOISED_SLOPES => START_SLOPE_DENOISED.atanh(),
        DENOISED_SLOPES..BANDWIDTHS => 0.0,
        BANDWIDTHS..CENTRE => {
            inverse_softplus((1.0 / START_BANDWIDTHS[channel - BANDWIDTHS] - ACTIVATION_FLOOR).sqrt())
        }
        CENTRE => inverse_softplus(START_CENTRE - ACTIVATION_FLOOR),
        GATE => (gate / (1.0 - gate)).ln(),
        _ => 0.0,
    }
}

fn inverse_softplus(value: f64) -> f64 {
    value.exp_m1().ln()
}

#[cfg(test)]
mod tests {
    use super::*;
    use sspc_kernels::parameters::activation_f64;

    #[test]
    fn biases_activate_to_the_start() {
        let value = |c| activation_f64(c, start_output(c, 0.7)).0;
        assert!((value(1) - START_SLOPE_DENOISED).abs() < 1e-12);
        assert!((value(5)).abs() < 1e-12);
        for (m, gamma) in START_BANDWIDTHS.iter().enumerate() {
            assert!((value(BANDWIDTHS + m) / gamma - 1.0).abs() < 1e-9);
        }
        assert!((value(CENTRE) - START_CENTRE).abs() < 1e-9 && (value(GATE) - 0.7).abs() < 1e-12);
    }
}
