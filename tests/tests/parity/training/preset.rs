//! The paper's preset on the sample frame: relL2 after 20 epochs in Burn and in PyTorch.

use super::steps::steps;
use super::train::{Convolutions, EPSILON, train};
use crate::case::Case;
use sspc_core::corrector;
use sspc_core::features::Windows;
use sspc_core::gc::Taps;
use sspc_core::image::Image;
use sspc_core::io::{FrameFiles, RoleOverrides, read_frame, read_reference};
use sspc_core::metric::rel_l2;
use sspc_core::network::{Network, Shape};
use sspc_core::parameters::Form;
use sspc_core::plan::Plan;
use sspc_core::prepare::{Exposure, Prepared};
use sspc_core::simd::Isa;
use sspc_train::backend::Backend;
use sspc_train::fit::{noise_scaled_rate, objective};
use sspc_train::preset::{Preset, Settings};
use std::path::Path;

/// Two f32 trainings from one start part slowly: Adam moves every weight by about the rate whatever
/// its gradient's size, so weights whose gradients are rounding go different ways.
const RELATIVE_L2: f64 = 0.02;
/// The first loss, before any update: f32 against f32.
const FIRST_LOSS: f64 = 1e-5;
/// Every later loss.
const LOSS: f64 = 1e-3;
/// The noise that sets the paper's rate: one sum in f64, one in f32.
const RATE: f64 = 1e-4;

#[test]
fn the_papers_preset_gives_the_same_relative_l2() {
    let case = Case::load("paper-preset").unwrap_or_else(|error| panic!("{error}"));
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/sample");
    let files = FrameFiles::halves(root.join("a.exr"), root.join("b.exr"));
    let frame = read_frame(&files, &RoleOverrides::none()).expect("the sample frame");
    let reference = read_reference(&root.join("ref.exr"), None).expect("the sample's reference");
    let prepared = Prepared::new(&frame, Exposure::AsIs);
    let settings = Settings::of(Preset::Paper, 0);
    let objective = objective(&prepared, &settings);

    let steps = steps(&case);
    let rate = noise_scaled_rate(0.01, &[&prepared]);
    assert!((rate / steps[0].rate - 1.0).abs() <= RATE, "rate {rate}, in the reference {}", steps[0].rate);

    let shape = Shape::paper(Form::Paper);
    let start = Network { shape, weights: case.get("weights_start", &[shape.parameter_count()]).f32() };
    let size = (case.count("tile"), case.count("tile"));
    let (losses, network) = train(&objective, start, size, &steps, EPSILON, Backend::Flex, Convolutions::Kernels);

    let expected = &case.get("losses", &[steps.len()]).values;
    for (step, (found, expected)) in losses.iter().zip(expected).enumerate() {
        println!("step {}: loss {found:.6}, in the reference {expected:.6}", step + 1);
    }
    for (step, (found, expected)) in losses.iter().zip(expected).enumerate() {
        let error = (found / expected - 1.0).abs();
        let tolerance = if step == 0 { FIRST_LOSS } else { LOSS };
        assert!(error <= tolerance, "loss of step {} off by {error:.2e}", step + 1);
    }

    let found = rel_l2(&corrected(&prepared, &network), &reference).value;
    let expected = case.get("relative_l2", &[1]).values[0];
    let denoised = case.get("relative_l2_denoised", &[1]).values[0];
    println!("relL2 {found:.6}, in the reference {expected:.6}; denoised halves {denoised:.6}");
    let error = (found / expected - 1.0).abs();
    assert!(error <= RELATIVE_L2, "relL2 {found:.6}, in the reference {expected:.6}: off by {:.2} %", 100.0 * error);
}

/// The paper's picture: max(0, (μ̂^a + μ̂^b) / 2).
fn corrected(prepared: &Prepared, network: &Network) -> Image {
    let plan = Plan::everything(prepared.height(), prepared.width());
    let taps = Taps::square(Settings::of(Preset::Paper, 0).radius);
    let halves = prepared.halves.each_ref().map(|features| {
        let parameters = corrector::parameters(Isa::best(), Form::Paper, network, features, &plan);
        let windows = Windows::new(features, None, prepared.set, taps.radius());
        corrector::correct(Isa::best(), Form::Paper, &windows, &taps, &parameters, &plan)
    });
    let mut mean = Image::mean_of(&halves[0], &halves[1]);
    mean.data_mut().iter_mut().for_each(|v| *v = v.max(0.0));
    mean
}
