//! Activations of the network's outputs, and their derivatives, over the whole range of f32.

use crate::table::{Table, Worst};
use sspc_kernels::parameters::{self, BANDWIDTHS, CENTRE, Form, GATE, activation_f64};

/// exp2 and log2 keep 4e-7; exponents near 88 carry their own rounding into 2^x.
const TOLERANCE: Worst = Worst { value: 1e-5, gradient: 2e-5 };
/// tanh is 1 - e over 1 + e: near 0 it is exact to the last bit of 1, not of itself.
const SLOPE_FLOOR: f64 = 1e-1;
/// exp2 ends at 2^-126, where the truth goes on falling.
const FLOOR: f64 = 1e-30;

#[test]
fn activations_match_f64_from_end_to_end() {
    let mut outputs: Vec<f32> = (-1200..=1200).map(|i| i as f32 / 12.0).collect();
    for magnitude in [1e-30, 1e-8, 1e-4, 1e3, 1e5, 1e10, 1e19, 1e30, f32::MAX] {
        outputs.extend([magnitude, -magnitude]);
    }
    let mut table = Table::new("Activations against f64, relative", TOLERANCE);
    for (name, channel) in [("slopes, tanh", 0), ("bandwidths", BANDWIDTHS), ("centre", CENTRE), ("gate", GATE)] {
        table.row(name, |isa| {
            let form = Form::Gated;
            let raw: Vec<f32> = (0..form.parameters()).flat_map(|_| outputs.iter().copied()).collect();
            let mut values = raw.clone();
            parameters::activate(isa, form, &mut values);
            let mut slopes = vec![1.0; raw.len()];
            parameters::activate_backward(isa, form, &raw, &mut slopes);
            let mut worst = Worst::default();
            for (i, &o) in outputs.iter().enumerate() {
                let (value, slope) = activation_f64(channel, f64::from(o));
                let at = channel * outputs.len() + i;
                let floor = if channel == 0 { SLOPE_FLOOR } else { FLOOR };
                worst.of_value(values[at], value, value.abs().max(floor));
                worst.of_gradient(slopes[at], slope, slope.abs().max(FLOOR));
            }
            worst
        });
    }
    table.finish();
}
