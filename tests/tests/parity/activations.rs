//! Activation of the network's outputs and its gradient.

use sspc_kernels::parameters::{Form, activate, activate_backward};
use sspc_kernels::simd::Isa;
use sspc_testkit::case::{Array, Case};
use sspc_testkit::closeness::{Mismatch, Relative, Worst, assert_close, assert_sensitive, compare};

/// exp2 and log2 by polynomials of a few 1e-7, squared and inverted.
const ACTIVATION: f64 = 1e-5;
/// tanh near 0 is a difference of values near 1, exact to 1e-7 and not to a part of itself; a slope
/// multiplies differences that stand beside y_i in a sum, where its absolute error is what counts.
const ACTIVATION_FLOOR: f64 = 1e-2;
/// As the activations.
const GRADIENT: f64 = 1e-4;
/// The reference's own 1 - tanh² and s (1 - s) are exact to 1e-16 where tanh and s are near 1.
const GRADIENT_FLOOR: f64 = 1e-10;

#[test]
fn activations_match_from_minus_40_to_40() {
    for case in Case::of_kind("activations") {
        let (height, width) = case.size("raw");
        let shape = [16, height, width];
        let raw = case.get("raw", &shape).f32();
        for isa in Isa::available() {
            let stage = format!("{} {} parameters", case.name, isa.name());
            let mut found = raw.clone();
            activate(isa, Form::Gated, &mut found);
            let expected = case.get("parameters", &shape);
            let worst = check_channels(&stage, expected, &found).unwrap_or_else(|mismatch| panic!("{mismatch}"));
            println!("{stage}: worst {:.1e} of the slopes, {:.1e} of the others", worst[0].0, worst[1].0);
            for channel in [0, 9, 14, 15] {
                assert_sensitive(&format!("{stage}, raw output {channel}"), |error| {
                    let mut moved = raw.clone();
                    let plane = height * width;
                    moved[channel * plane..(channel + 1) * plane].iter_mut().for_each(|o| *o *= 1.0 + error as f32);
                    activate(isa, Form::Gated, &mut moved);
                    check_channels("perturbed", expected, &moved).is_err()
                });
            }
        }
    }
}

/// Slopes with their floor, the other parameters relative to themselves alone; the worst of each.
fn check_channels(stage: &str, expected: &Array, found: &[f32]) -> Result<[Worst; 2], Box<Mismatch>> {
    let pixels = expected.shape[1] * expected.shape[2];
    let check = |first: usize, last: usize, floor: f64| {
        let (part, found) = (expected.slab(first, last), &found[first * pixels..last * pixels]);
        compare(stage, &part, found, Relative::ToEach { floor }, ACTIVATION)
    };
    Ok([check(0, 9, ACTIVATION_FLOOR)?, check(9, 16, 0.0)?])
}

#[test]
fn activation_gradients_match_from_minus_40_to_40() {
    for case in Case::of_kind("activations") {
        let (height, width) = case.size("raw");
        let shape = [16, height, width];
        let raw = case.get("raw", &shape).f32();
        let upstream = case.get("upstream", &shape).f32();
        let expected = case.get("d_raw", &shape);
        let relative = Relative::ToEach { floor: GRADIENT_FLOOR };
        for isa in Isa::available() {
            let stage = format!("{} {} d_raw", case.name, isa.name());
            let mut found = upstream.clone();
            activate_backward(isa, Form::Gated, &raw, &mut found);
            let worst = assert_close(&stage, expected, &found, relative, GRADIENT);
            println!("{stage}: worst {:.1e}", worst.0);
            assert_sensitive(&stage, |error| {
                let scaled: Vec<f32> = found.iter().map(|g| g * (1.0 + error as f32)).collect();
                compare(&stage, expected, &scaled, relative, GRADIENT).is_err()
            });
        }
    }
}
