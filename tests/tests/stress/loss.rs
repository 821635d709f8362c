//! The self-supervised loss of a network's outputs, activations and g_c included, against f64.

use crate::cases::{self, Case, SMALLEST};
use crate::table::{Table, Worst};
use sspc_core::objective::{Objective, PixelLoss, Tile};
use sspc_kernels::features::{DENOISED, FeatureSet, RADIANCE};
use sspc_kernels::gc::{self, PAPER_RADIUS, Taps};
use sspc_kernels::parameters::{Form, activation_f64};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_testkit::kernels::{activated, loss_of_tiles};

/// A squared error is off by twice what its difference is off by, and the weights by their own rounding.
const TOLERANCE: Worst = Worst { value: 1e-5, gradient: 1e-4 };
/// An error is the difference of picture and target: it is known to about 1e-5 of their sizes, and the
/// gradient, which is judged to 1e-4, to a tenth of them.
const SHARE_OF_SIZE: f64 = 0.1;

fn measure(case: &Case, form: Form, influence: f32, isa: Isa) -> Worst {
    let set = FeatureSet::ALL;
    let (taps, prepared) = (Taps::square(PAPER_RADIUS), case.prepared());
    let objective = Objective::new(&prepared, form, taps.clone(), set);
    let windows = Windows::new(&case.halves[0], case.valid.as_ref(), set, PAPER_RADIUS);
    let region = Region::whole(case.height(), case.width());
    let (pixels, width) = (region.pixels(), region.width);
    let raw = case.outputs(form);
    let scale = 1.0 / (3 * pixels) as f32;
    let tiles = [Tile::upright(0, region)];
    let (loss, gradient) = loss_of_tiles(&objective, isa, &tiles, raw, PixelLoss { scale, influence });

    let p = activated(isa, form, raw);
    let (scale, influence, other) = (f64::from(scale), f64::from(influence), &case.halves[1]);
    let (mut truth, mut size_of_loss, mut worst) = (0.0, 0.0, Worst::default());
    for i in 0..pixels {
        let at = |c: usize| f64::from(other.plane(c)[i]);
        let own: Vec<f64> = (0..form.parameters()).map(|c| f64::from(p[c * pixels + i])).collect();
        let pixel = |up: [f64; 3]| gc::oracle::pixel(&windows, &taps, form, &own, i / width, i % width, up);
        let forward = pixel([0.0; 3]);
        let mean = (at(DENOISED) + at(DENOISED + 1) + at(DENOISED + 2)) / 3.0;
        let counts = prepared.is_valid(i);
        let weight = if counts { 1.0 / (mean * mean + 0.01) } else { 0.0 };
        let error: [f64; 3] = std::array::from_fn(|k| forward.corrected[k] - at(RADIANCE + k));
        let size: [f64; 3] = std::array::from_fn(|k| forward.magnitude[k] + at(RADIANCE + k));
        let relative = weight * error.iter().map(|e| e * e).sum::<f64>();
        truth += scale * relative;
        size_of_loss +=
            (0..3).map(|k| scale * weight * size[k] * (error[k].abs() + SHARE_OF_SIZE * size[k])).sum::<f64>();
        let slope = 2.0 * scale * weight / (1.0 + relative / (influence * influence)).sqrt();
        let backward = pixel(error.map(|e| slope * e));
        let known: [f64; 3] = std::array::from_fn(|k| slope * (error[k].abs() + SHARE_OF_SIZE * size[k]));
        let floor = known.iter().sum::<f64>() * case.of_vanished_weights().gradient / TOLERANCE.gradient;
        let sizes = pixel(known);
        for c in 0..form.parameters() {
            let activation = activation_f64(c, f64::from(raw[c * pixels + i])).1;
            let size = (sizes.gradient_magnitude[c] + floor) * activation.abs();
            worst.of_gradient(gradient[c * pixels + i], backward.gradient[c] * activation, size.max(SMALLEST));
        }
    }
    worst.of_value(loss as f32, truth, size_of_loss.max(SMALLEST));
    worst
}

#[test]
fn the_loss_and_its_gradient_match_f64() {
    for (form, influence) in [(Form::Gated, 1.0), (Form::Paper, f32::INFINITY)] {
        let title =
            format!("Loss ({form:?}, influence {influence}) against f64, relative to what it is the difference of");
        let mut table = Table::new(&title, TOLERANCE);
        cases::all().iter().for_each(|case| table.row(&case.name, |isa| measure(case, form, influence, isa)));
        table.finish();
    }
}
