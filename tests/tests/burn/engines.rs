//! Every engine against every other on the same inputs: the parity case `pipeline`, both graphs.
//!
//! Network: PyTorch (the case), Burn's own convolutions on flex and on ndarray, our kernels in every instruction set,
//! tract's own operators, onnxruntime. Picture: PyTorch, our kernels, Burn's network with our g_c as its operation, the
//! image graph in tract and in onnxruntime. onnxruntime needs the virtual environment of the PyTorch reference, whose
//! interpreter `SSPC_PYTHON_VENV` names; without it these columns are left out aloud.

use super::BACKENDS;
use super::convolutions::Network;
use sspc_image::Image;
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::Taps;
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_onnx::{Contract, Model, write_image, write_network};
use sspc_testkit::case;
use sspc_testkit::frames::planes;
use sspc_testkit::kernels::{Pass, activated, correct};
use sspc_testkit::method;
use sspc_testkit::skips::python;
use sspc_train::backend::Backend;
use std::path::PathBuf;
use std::process::Command;
use tract_onnx::prelude::*;

/// The bounds that were asked for, relative to a plane's mean magnitude or the value's own, whichever is larger.
const NETWORK_TOLERANCE: f64 = 1e-4;
const PICTURE_TOLERANCE: f64 = 1e-3;

/// One engine's result for both halves, `[2, C, H, W]` flat.
struct Answer {
    engine: String,
    values: Vec<f32>,
}

/// The case's arrays.
struct Case {
    weights: Vec<f32>,
    features: Vec<f32>,
    parameters: Vec<f32>,
    pictures: Vec<f32>,
    height: usize,
    width: usize,
}

impl Case {
    fn load() -> Self {
        let case = case::Case::named("pipeline");
        let (height, width) = case.size("features");
        let array = |name: &str| case.any(name).f32();
        let [weights, features] = ["weights", "features"].map(array);
        let [parameters, pictures] = ["parameters", "mu_hat"].map(array);
        Self { weights, features, parameters, pictures, height, width }
    }

    fn pixels(&self) -> usize {
        self.height * self.width
    }

    fn half(&self, h: usize) -> Image {
        let size = FEATURE_CHANNELS * self.pixels();
        Image::from_planes(FEATURE_CHANNELS, self.height, self.width, self.features[h * size..][..size].to_vec())
    }

    fn model(&self) -> Model {
        Model::new(Contract::new(Form::Gated), self.weights.clone()).expect("the case's weights")
    }

    /// Channels `first..first + channels` of both halves, `[2, channels, H, W]`.
    fn part(&self, first: usize, channels: usize) -> Vec<f32> {
        (0..2).flat_map(|h| planes(&self.half(h), first, channels).into_data()).collect()
    }

    /// Raw outputs of both halves by Burn's own convolutions.
    fn burn(&self, backend: Backend) -> Vec<f32> {
        let (features, height, width) = (&self.features, self.height, self.width);
        Network { shape: Contract::new(Form::Gated).shape, features, height, width, backend }.outputs(&self.weights)
    }

    /// Raw outputs of half `h` by our kernels.
    fn ours(&self, isa: Isa, h: usize) -> Vec<f32> {
        let shape = Contract::new(Form::Gated).shape;
        Pass::forward(isa, &shape, &self.weights, self.half(h).data(), self.height, self.width).outputs
    }

    /// μ̂ of half `h` by our g_c, of a network's raw outputs.
    fn corrected(&self, isa: Isa, h: usize, outputs: &[f32]) -> Vec<f32> {
        let taps = Taps::square(Contract::new(Form::Gated).window_radius);
        let windows = Windows::new(&self.half(h), None, FeatureSet::ALL, taps.radius());
        let region = Region::whole(self.height, self.width);
        correct(isa, Form::Gated, &windows, &taps, region, &activated(isa, Form::Gated, outputs))
    }
}

fn network_answers(case: &Case) -> Vec<Answer> {
    let mut answers = vec![Answer { engine: "PyTorch".into(), values: case.parameters.clone() }];
    for backend in BACKENDS {
        let outputs = case.burn(backend);
        let halves = outputs.chunks_exact(outputs.len() / 2);
        let values = halves.flat_map(|half| activated(Isa::Portable, Form::Gated, half)).collect();
        answers.push(Answer { engine: format!("Burn {backend}"), values });
    }
    let ours = Isa::available().into_iter().map(|isa| (format!("ours {}", isa.name()), Kernels::Fused(isa)));
    for (engine, kernels) in ours.chain([("tract".to_string(), Kernels::Tract)]) {
        let runner = Engine::new(case.model(), kernels, 7);
        let parameters = |h| method::parameters(&runner, &case.half(h)).into_data();
        answers.push(Answer { engine, values: [parameters(0), parameters(1)].concat() });
    }
    answers
}

fn picture_answers(case: &Case) -> Vec<Answer> {
    let mut answers = vec![Answer { engine: "PyTorch".into(), values: case.pictures.clone() }];
    for isa in Isa::available() {
        let values = (0..2).flat_map(|h| case.corrected(isa, h, &case.ours(isa, h))).collect();
        answers.push(Answer { engine: format!("ours {}", isa.name()), values });
    }
    for backend in BACKENDS {
        let outputs = case.burn(backend);
        let halves = outputs.chunks_exact(outputs.len() / 2).enumerate();
        let values = halves.flat_map(|(h, half)| case.corrected(Isa::best(), h, half)).collect();
        answers.push(Answer { engine: format!("Burn {backend}"), values });
    }
    answers.push(Answer { engine: "tract image graph".into(), values: tract_pictures(case) });
    answers
}

/// Inputs of the image graph: name, first feature channel, channels.
const INPUTS: [(&str, usize, usize); 5] =
    [("radiance", 0, 3), ("denoised", 10, 3), ("albedo", 3, 3), ("visibility", 6, 1), ("normal", 7, 3)];

fn tract_pictures(case: &Case) -> Vec<f32> {
    let bytes = write_image(&case.model());
    let mut graph = tract_onnx::onnx().model_for_read(&mut &bytes[..]).expect("the image graph");
    let mut inputs: TVec<TValue> = tvec!();
    for (i, (_, first, channels)) in INPUTS.into_iter().enumerate() {
        let shape = [2, channels, case.height, case.width];
        graph = graph.with_input_fact(i, f32::fact(shape).into()).expect("an input");
        inputs.push(
            tract_onnx::prelude::Tensor::from_shape(&shape, &case.part(first, channels)).expect("a tensor").into(),
        );
    }
    inputs.push(tensor1(&[1.0f32]).into());
    let plan = graph.into_optimized().and_then(|graph| graph.into_runnable()).expect("a plan");
    let outputs = plan.run(inputs).expect("runs");
    outputs[1].to_plain_array_view::<f32>().expect("f32").iter().copied().collect()
}

/// Both graphs in onnxruntime: parameters and pictures.
fn onnxruntime(case: &Case) -> Option<[Answer; 2]> {
    let python = python("onnxruntime among the engines")?;
    let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../infer/tests/run_graphs.py");
    let folder = tempfile::tempdir().expect("folder");
    let at = |name: &str| folder.path().join(name);
    let put = |name: &str, values: &[f32]| {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        std::fs::write(at(&format!("{name}.f32")), bytes).expect("array");
    };
    std::fs::write(at("network.onnx"), write_network(&case.model())).expect("model");
    std::fs::write(at("image.onnx"), write_image(&case.model())).expect("model");
    let mut shapes = serde_json::json!({"exposure": [1]});
    put("exposure", &[1.0]);
    for (name, first, channels) in INPUTS.into_iter().chain([("features", 0, FEATURE_CHANNELS)]) {
        put(name, &case.part(first, channels));
        shapes[name] = serde_json::json!([2, channels, case.height, case.width]);
    }
    std::fs::write(at("arrays.json"), shapes.to_string()).expect("shapes");
    let output = Command::new(python).current_dir(folder.path()).arg(script).output().expect("python runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let get = |name: &str| {
        let bytes = std::fs::read(at(&format!("{name}.f32"))).expect("array");
        let values = bytes.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        Answer { engine: "onnxruntime".into(), values }
    };
    Some([get("parameters"), get("halves")])
}

/// The worst difference of two answers, relative to the mean of their planes or to the value.
fn difference(a: &Answer, b: &Answer, pixels: usize) -> f64 {
    assert_eq!(a.values.len(), b.values.len(), "{} against {}", a.engine, b.engine);
    let mut worst = 0.0f64;
    for (p, q) in a.values.chunks_exact(pixels).zip(b.values.chunks_exact(pixels)) {
        let mean = q.iter().map(|v| f64::from(v.abs())).sum::<f64>() / pixels as f64;
        for (p, q) in p.iter().zip(q) {
            let error = f64::from((p - q).abs()) / mean.max(f64::from(q.abs()));
            worst = if error.is_nan() { f64::INFINITY } else { worst.max(error) };
        }
    }
    worst
}

fn assert_all_agree(what: &str, answers: &[Answer], pixels: usize, tolerance: f64) {
    let mut apart = Vec::new();
    for (i, a) in answers.iter().enumerate() {
        for b in &answers[..i] {
            let worst = difference(a, b, pixels);
            println!("{what}: {:>18} against {:<18} {worst:.1e}", a.engine, b.engine);
            if worst > tolerance {
                apart.push(format!("{} against {}: {worst:.1e}", a.engine, b.engine));
            }
        }
    }
    assert!(apart.is_empty(), "{what}, more than {tolerance:.0e} apart: {apart:?}");
}

#[test]
fn every_engine_agrees_with_every_other() {
    let case = Case::load();
    let (mut networks, mut pictures) = (network_answers(&case), picture_answers(&case));
    if let Some([parameters, halves]) = onnxruntime(&case) {
        networks.push(parameters);
        pictures.push(halves);
    }
    assert_all_agree("parameters", &networks, case.pixels(), NETWORK_TOLERANCE);
    assert_all_agree("picture", &pictures, case.pixels(), PICTURE_TOLERANCE);
}

/// The comparison itself: one value of one engine off by a little more than the bound is seen.
#[test]
fn one_wrong_value_is_seen() {
    let case = Case::load();
    let right = Answer { engine: "right".into(), values: case.parameters.clone() };
    let mut wrong = case.parameters.clone();
    let at = (0..wrong.len()).max_by(|&i, &j| wrong[i].abs().total_cmp(&wrong[j].abs())).expect("values");
    wrong[at] *= 1.0 + 2.0 * NETWORK_TOLERANCE as f32;
    let wrong = Answer { engine: "wrong".into(), values: wrong };
    assert!(difference(&wrong, &right, case.pixels()) > NETWORK_TOLERANCE);
}
