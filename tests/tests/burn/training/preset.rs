//! The paper's preset on the sample frame: relL2 after 20 epochs in Burn and in PyTorch.

use super::steps::steps;
use super::train::{Convolutions, EPSILON, Step, train};
use sspc_core::prepare::{Exposure, FrameStats, Prepared};
use sspc_image::Frame;
use sspc_kernels::network::{Network, Shape};
use sspc_kernels::parameters::Form;
use sspc_metrics::rel_l2;
use sspc_onnx::Contract;
use sspc_testkit::case::{self, Case};
use sspc_testkit::frames::{sample, sample_folder, sample_reference};
use sspc_testkit::method::{correct, settings, window_network};
use sspc_train::backend::Backend;
use sspc_train::fit::{noise_scaled_rate, objective};
use sspc_train::preset::{Preset, Settings};
use std::path::Path;
use std::process::Command;
use std::time::Instant;

/// Two f32 trainings from one start part slowly: Adam moves every weight by about the rate whatever
/// its gradient's size, so weights whose gradients are rounding go different ways.
const RELATIVE_L2: f64 = 0.02;
/// The first loss, before any update: f32 against f32.
const FIRST_LOSS: f64 = 1e-5;
/// Every later loss.
const LOSS: f64 = 1e-3;
/// The noise that sets the paper's rate: one sum in f64, one in f32.
const RATE: f64 = 1e-4;

/// The case's frame and start, ready to be trained.
struct Setup {
    case: Case,
    frame: Frame,
    prepared: Prepared,
    steps: Vec<Step>,
}

impl Setup {
    fn new() -> Self {
        let case = Case::named("paper-preset");
        let frame = sample();
        Self {
            steps: steps(&case),
            prepared: Prepared::by_stats(&frame, &FrameStats::of(&frame, Exposure::AsIs)),
            frame,
            case,
        }
    }

    fn train(&self) -> (Vec<f64>, Network) {
        let objective = objective(&self.prepared, &Settings::of(Preset::Paper, 0));
        let shape = Shape::paper(Form::Paper);
        let weights = self.case.get("weights_start", &[shape.parameter_count()]).f32();
        let size = (self.case.count("tile"), self.case.count("tile"));
        let start = Network { shape, weights };
        train(&objective, start, size, &self.steps, EPSILON, Backend::Flex, Convolutions::Kernels)
    }
}

fn assert_losses(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len(), "one loss a step");
    for (step, (found, expected)) in found.iter().zip(expected).enumerate() {
        println!("step {}: loss {found:.6}, in the reference {expected:.6}", step + 1);
        let error = (found / expected - 1.0).abs();
        let tolerance = if step == 0 { FIRST_LOSS } else { LOSS };
        assert!(error <= tolerance, "loss of step {} off by {error:.2e}", step + 1);
    }
}

#[test]
fn the_papers_preset_gives_the_same_relative_l2() {
    let setup = Setup::new();
    let (case, steps) = (&setup.case, &setup.steps);
    let rate = noise_scaled_rate(0.01, &[&setup.prepared]);
    assert!((rate / steps[0].rate - 1.0).abs() <= RATE, "rate {rate}, in the reference {}", steps[0].rate);

    let (losses, network) = setup.train();
    assert_losses(&losses, &case.get("losses", &[steps.len()]).values);

    let reference = sample_reference();
    let how = settings(&Contract::new(Form::Paper));
    let stats = FrameStats::of(&setup.frame, Exposure::AsIs);
    let picture = correct(&setup.frame, stats, &window_network(Form::Paper, &network), &how).picture;
    let found = rel_l2(&picture, &reference).value;
    let expected = case.get("relative_l2", &[1]).values[0];
    let denoised = case.get("relative_l2_denoised", &[1]).values[0];
    println!("relL2 {found:.6}, in the reference {expected:.6}; denoised halves {denoised:.6}");
    let error = (found / expected - 1.0).abs();
    assert!(error <= RELATIVE_L2, "relL2 {found:.6}, in the reference {expected:.6}: off by {:.2} %", 100.0 * error);
}

/// The same fit in PyTorch and here, one after the other, both on RAYON_NUM_THREADS threads (default
/// 1), as a ratio. Minutes, hence not part of every run:
/// `SSPC_PYTHON_VENV=$(.ci/setup-python) cargo test --release -p sspc-tests --test burn -- --ignored --nocapture`
#[test]
#[ignore = "takes minutes; needs SSPC_PYTHON_VENV"]
fn the_same_fit_is_timed_in_pytorch_and_here() {
    let python = std::env::var("SSPC_PYTHON_VENV").expect("SSPC_PYTHON_VENV: the interpreter .ci/setup-python prints");
    let threads = std::env::var("RAYON_NUM_THREADS").unwrap_or_else(|_| "1".into());
    rayon::ThreadPoolBuilder::new().num_threads(threads.parse().expect("threads")).build_global().expect("threads");
    let setup = Setup::new();
    let case = case::root().join(&setup.case.name);
    let output = Command::new(python)
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("../reference-py"))
        .args(["-m", "sspc_reference", "--threads", &threads, "time", "--plan"])
        .arg(case)
        .args([sample_folder().join("a.exr"), sample_folder().join("b.exr")])
        .output()
        .expect("python");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let record: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON of the reference");
    let expected: Vec<f64> = serde_json::from_value(record["losses"].clone()).expect("losses");

    let start = Instant::now();
    let (losses, _) = setup.train();
    let seconds = start.elapsed().as_secs_f64();
    assert_losses(&losses, &expected);
    let torch = record["seconds"].as_f64().expect("seconds");
    println!(
        "{} steps of {} pixels, {threads} thread(s): {} {torch:.1} s, sspc-train {seconds:.2} s, ratio {:.0}",
        setup.steps.len(),
        record["pixels_per_step"],
        record["implementation"].as_str().unwrap_or("?"),
        torch / seconds
    );
}
