//! g_c and its gradient against f64.

use crate::cases::{self, Case, SMALLEST};
use crate::table::{Table, Worst};
use sspc_core::rng::Rng;
use sspc_kernels::features::FeatureSet;
use sspc_kernels::gc::{self, PAPER_RADIUS, Taps};
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_testkit::kernels::{activated, correct_and_back};

/// Sums of 361 terms whose exponents carry the rounding of γ·d, up to 88 times 6e-8; relative to the sum
/// of the terms without their signs.
const TOLERANCE: Worst = Worst { value: 1e-5, gradient: 2e-5 };

fn measure(case: &Case, form: Form, isa: Isa) -> Worst {
    let windows = Windows::new(&case.halves[0], case.valid.as_ref(), FeatureSet::ALL, PAPER_RADIUS);
    let (taps, region) = (Taps::square(PAPER_RADIUS), Region::whole(case.height(), case.width()));
    let pixels = region.pixels();
    let rng = &mut Rng::new(9);
    let upstream: Vec<f32> = (0..3 * pixels).map(|_| rng.normal()).collect();
    let p = activated(isa, form, case.outputs(form));
    let (out, gradient) = correct_and_back(isa, form, &windows, &taps, region, &p, &upstream);

    let mut worst = Worst::default();
    let vanished = case.of_vanished_weights();
    for i in 0..pixels {
        // On the very f32 parameters that the kernel gets.
        let at: Vec<f64> = (0..form.parameters()).map(|c| f64::from(p[c * pixels + i])).collect();
        let up = std::array::from_fn(|k| f64::from(upstream[k * pixels + i]));
        let truth = gc::oracle::pixel(&windows, &taps, form, &at, i / region.width, i % region.width, up);
        for k in 0..3 {
            worst.of_value(
                out[k * pixels + i],
                truth.corrected[k],
                truth.magnitude[k] + vanished.value / TOLERANCE.value,
            );
        }
        for c in 0..form.parameters() {
            let floor = up.iter().map(|u: &f64| u.abs()).sum::<f64>() * vanished.gradient / TOLERANCE.gradient;
            let scale = truth.gradient_magnitude[c] + floor.max(SMALLEST);
            worst.of_gradient(gradient[c * pixels + i], truth.gradient[c], scale);
        }
    }
    worst
}

#[test]
fn g_c_and_its_gradient_match_f64() {
    for form in [Form::Gated, Form::Paper] {
        let title = format!("g_c ({form:?}) against f64, relative to the sum of the terms' sizes");
        let mut table = Table::new(&title, TOLERANCE);
        cases::all().iter().for_each(|case| table.row(&case.name, |isa| measure(case, form, isa)));
        table.finish();
    }
}
