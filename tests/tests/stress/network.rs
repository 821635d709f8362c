//! The network and its gradient against f64.

use crate::cases::{self, Case};
use crate::table::{Table, Worst};
use sspc_core::rng::Rng;
use sspc_image::Image;
use sspc_kernels::network::{self, Shape};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_testkit::kernels::Pass;

/// Four layers of up to 144 f32 products each.
const TOLERANCE: Worst = Worst { value: 1e-5, gradient: 1e-5 };

/// Small, so that pixels away from a bright one are judged by what they see themselves.
fn shape() -> Shape {
    Shape { layers: 4, ..Shape::paper(Form::Gated) }
}

/// Largest magnitude of any output within the network's reach of a pixel.
fn local_size(truth: &[f64], shape: &Shape, height: usize, width: usize) -> Vec<f64> {
    let (reach, pixels) = (shape.radius(), height * width);
    let at = |i: usize| (0..shape.outputs).map(|c| truth[c * pixels + i].abs()).fold(0.0, f64::max);
    (0..pixels)
        .map(|i| {
            let (y, x) = (i / width, i % width);
            let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
            let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
            rows.flat_map(|y| columns.clone().map(move |x| at(y * width + x))).fold(1e-30, f64::max)
        })
        .collect()
}

fn measure(case: &Case, isa: Isa) -> Worst {
    let shape = shape();
    let rng = &mut Rng::new(4);
    let weights: Vec<f32> = (0..shape.parameter_count()).map(|_| 0.15 * rng.normal()).collect();
    let (height, width) = (case.height(), case.width());
    let pixels = height * width;
    let upstream = Image::from_fn(shape.outputs, height, width, |_, _, _| rng.normal());
    let exact = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<f64>>();
    let (features, w) = (exact(case.halves[0].data()), exact(&weights));
    let truth = network::oracle::forward(&shape, &w, &features, height, width).pop().unwrap_or_default();
    let truth_gradient = network::oracle::backward(&shape, &w, &features, height, width, &exact(upstream.data()));

    let pass = Pass::forward(isa, &shape, &weights, case.halves[0].data(), height, width);
    let gradient = pass.backward(upstream.data());
    let mut worst = Worst::default();
    let sizes = local_size(&truth, &shape, height, width);
    for (i, (&got, t)) in pass.outputs.iter().zip(&truth).enumerate() {
        worst.of_value(got, *t, sizes[i % pixels]);
    }
    for l in 0..shape.layers {
        let part = shape.layer_start(l)..shape.layer_start(l) + shape.layer_len(l);
        let scale = truth_gradient[part.clone()].iter().fold(1e-30, |m: f64, t| m.max(t.abs()));
        for (&got, t) in gradient[part.clone()].iter().zip(&truth_gradient[part]) {
            worst.of_gradient(got, *t, scale);
        }
    }
    worst
}

#[test]
fn the_network_and_its_gradient_match_f64() {
    let title = "Network against f64, relative to the largest output in reach and gradient of the layer";
    let mut table = Table::new(title, TOLERANCE);
    cases::all().iter().for_each(|case| table.row(&case.name, |isa| measure(case, isa)));
    table.finish();
}
