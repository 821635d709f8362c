//! The whole pipeline on one case, stage by stage in the order of the data, to name the first stage
//! that differs and not only the last.
//!
//! The stages of the run are left as `pipeline.npz` beside the error maps (cargo's `target/tmp`):
//! `sspc-reference compare tests/cases/pipeline/io.npz target/tmp/pipeline.npz` reads them too.

use npyz::WriterBuilder;
use npyz::npz::NpzWriter;
use sspc_core::frame_stats::FrameStats;
use sspc_core::objective::{HalfObjective, Objective, PixelLoss, Tile};
use sspc_core::prepare::{Exposure, Prepared};
use sspc_image::Frame;
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_kernels::gc::Taps;
use sspc_kernels::network::{PackedNetwork, Shape, sum_in_order};
use sspc_kernels::parameters::Form;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_testkit::case::{Array, Case};
use sspc_testkit::closeness::{Relative, compare, largest, scratch};
use sspc_testkit::frames::frame_of;
use sspc_testkit::kernels::{Pass, activated, correct, correct_and_back, loss_of_tiles};
use std::ops::Range;
use std::path::Path;

/// A stage's name, and what its values may differ by, relative to the stage's largest.
type Stage = (&'static str, f64);
/// Copied, never computed.
const FEATURES: f64 = 0.0;
/// A few dozen roundings of 6e-8.
const FORWARD: f64 = 1e-5;
/// A mean of positive terms.
const LOSS: f64 = 1e-6;
/// Sums of terms of both signs.
const GRADIENT: f64 = 1e-4;

const STAGES: [Stage; 25] = [
    ("features", FEATURES),
    ("layer_1", FORWARD),
    ("layer_2", FORWARD),
    ("layer_3", FORWARD),
    ("layer_4", FORWARD),
    ("layer_5", FORWARD),
    ("layer_6", FORWARD),
    ("layer_7", FORWARD),
    ("layer_8", FORWARD),
    ("layer_9", FORWARD),
    ("parameters", FORWARD),
    ("g", FORWARD),
    ("mu_hat", FORWARD),
    ("loss", LOSS),
    ("d_parameters", GRADIENT),
    ("d_raw", GRADIENT),
    ("d_layer_9", GRADIENT),
    ("d_layer_8", GRADIENT),
    ("d_layer_7", GRADIENT),
    ("d_layer_6", GRADIENT),
    ("d_layer_5", GRADIENT),
    ("d_layer_4", GRADIENT),
    ("d_layer_3", GRADIENT),
    ("d_layer_2", GRADIENT),
    ("d_layer_1", GRADIENT),
];

/// What goes wrong on purpose, to see it named.
#[derive(Clone, Copy, Default)]
struct Fault {
    /// Scales the weights of this layer (1..=9).
    layer: Option<usize>,
    /// The same, in the backward pass alone.
    layer_backward: Option<usize>,
    /// Scales this channel of the activated parameters.
    parameter: Option<usize>,
    /// Scales the loss and its gradient.
    loss: bool,
    /// Swaps y and z.
    features: bool,
}

/// By how much a fault scales.
const FAULT: f32 = 1.001;

/// One run: every stage's values, both halves one after another.
fn run(case: &Case, isa: Isa, fault: Fault) -> Vec<Vec<f32>> {
    let (height, width) = case.size("radiance");
    let mut frame = frame(case);
    if fault.features {
        std::mem::swap(&mut frame.a.radiance, &mut frame.a.denoised);
    }
    let prepared = Prepared::by_stats(&frame, &FrameStats::of(&frame, Exposure::AsIs));
    let halves = prepared.halves.each_ref().map(|half| half.data());
    let forward = |shape: &Shape, weights: &[f32]| {
        halves.map(|features| Pass::forward(isa, shape, weights, features, height, width))
    };

    let shape = Shape::paper(Form::Gated);
    let mut weights = case.get("weights", &[shape.parameter_count()]).f32();
    scale_layer(&shape, &mut weights, fault.layer);
    let mut stages = vec![halves.concat()];
    for layers in 1..shape.layers {
        // The first layers alone are a network whose last layer lacks its ReLU.
        let start = Shape { layers, outputs: shape.hidden, ..shape };
        let passes = forward(&start, &weights[..start.parameter_count()]);
        let out = passes.iter().flat_map(|pass| pass.outputs.iter().map(|v| v.max(0.0))).collect();
        stages.push(out);
    }
    let passes = forward(&shape, &weights);
    let raw = passes.each_ref().map(|pass| pass.outputs.as_slice()).concat();

    let objective = Objective::new(&prepared, Form::Gated, Taps::square(case.count("radius")), prepared.set);
    let region = Region { top: 0, left: 0, height, width };
    let (mut parameters, mut g, mut mu_hat) = (Vec::new(), Vec::new(), Vec::new());
    for (half, raw) in objective.halves.iter().zip(raw.chunks_exact(16 * region.pixels())) {
        let mut activated = activated(isa, Form::Gated, raw);
        if let Some(channel) = fault.parameter {
            let plane = channel * region.pixels()..(channel + 1) * region.pixels();
            activated[plane].iter_mut().for_each(|p| *p *= FAULT);
        }
        let windows = half.planes.windows(region, Vec::new());
        for (form, out) in [(Form::Paper, &mut g), (Form::Gated, &mut mu_hat)] {
            let own = &activated[..form.parameters() * region.pixels()];
            out.extend(correct(isa, form, &windows, &objective.taps, region, own));
        }
        parameters.extend(activated);
    }
    let tiles = [0, 1].map(|half| Tile::upright(half, region));
    let scale = if fault.loss { FAULT } else { 1.0 } / (6 * region.pixels()) as f32;
    let measure = PixelLoss { scale, influence: f32::INFINITY };
    let (loss, d_raw) = loss_of_tiles(&objective, isa, &tiles, &raw, measure);
    let d_parameters = d_parameters(case, isa, &objective, region, &parameters);
    scale_layer(&shape, &mut weights, fault.layer_backward);
    let network = PackedNetwork::new(isa, shape, &weights);
    let upstream = d_raw.chunks_exact(16 * region.pixels());
    let of_halves: Vec<_> = passes.iter().zip(upstream).map(|(p, up)| p.backward_through(&network, up)).collect();
    let d_weights = sum_in_order(&of_halves);
    stages.extend([raw, parameters, g, mu_hat, vec![loss as f32], d_parameters, d_raw]);
    stages.extend((0..shape.layers).rev().map(|layer| d_weights[weights_of(&shape, layer)].to_vec()));
    stages
}

fn scale_layer(shape: &Shape, weights: &mut [f32], layer: Option<usize>) {
    if let Some(layer) = layer {
        weights[weights_of(shape, layer - 1)].iter_mut().for_each(|w| *w *= FAULT);
    }
}

/// Where layer `layer` (from 0) lies in the flat weights.
fn weights_of(shape: &Shape, layer: usize) -> Range<usize> {
    shape.layer_start(layer)..shape.layer_start(layer) + shape.layer_len(layer)
}

/// The gradient of both halves' activated parameters by the reference's own gradient of μ̂: the loss
/// kernel goes from μ̂ to the raw outputs without showing what lies between.
fn d_parameters(case: &Case, isa: Isa, objective: &Objective, region: Region, parameters: &[f32]) -> Vec<f32> {
    let upstream = case.get("d_mu_hat", &[2, 3, region.height, region.width]).f32();
    let halves = parameters.chunks_exact(16 * region.pixels()).zip(upstream.chunks_exact(3 * region.pixels()));
    let of_half = |(half, (parameters, upstream)): (&HalfObjective, (&[f32], &[f32]))| {
        let (windows, taps) = (half.planes.windows(region, Vec::new()), &objective.taps);
        correct_and_back(isa, Form::Gated, &windows, taps, region, parameters, upstream).1
    };
    objective.halves.iter().zip(halves).flat_map(of_half).collect()
}

fn frame(case: &Case) -> Frame {
    let both = case.any("features");
    frame_of(&[both.image(0), both.image(1)])
}

/// One line for each stage up to the first that differs, and that stage's name.
fn report(case: &Case, stages: &[Vec<f32>]) -> (String, Option<&'static str>) {
    let mut text = String::new();
    for ((name, tolerance), found) in STAGES.iter().zip(stages) {
        let expected = expected(case, name);
        let (stage, relative) = (format!("{} {name}", case.name), Relative::ToScale(largest(&expected)));
        match compare(&stage, &expected, found, relative, *tolerance) {
            Ok(worst) => text += &format!("{name}: equal, worst {:.1e} (<= {tolerance:.0e})\n", worst.0),
            Err(mismatch) => return (text + &format!("FIRST DIFFERENCE, {mismatch}\n"), Some(name)),
        }
    }
    (text, None)
}

fn expected(case: &Case, stage: &str) -> Array {
    let Some(layer) = stage.strip_prefix("d_layer_") else { return case.any(stage).clone() };
    let layer: usize = layer.parse().expect("a layer's number");
    let Range { start, end } = weights_of(&Shape::paper(Form::Gated), layer - 1);
    case.any("d_weights").slab(start, end)
}

#[test]
fn no_stage_of_the_pipeline_differs() {
    for case in Case::of_kind("pipeline") {
        let (height, width) = case.size("radiance");
        case.get("features", &[2, FEATURE_CHANNELS, height, width]);
        for isa in Isa::available() {
            let stages = run(&case, isa, Fault::default());
            let (text, differs) = report(&case, &stages);
            println!("{} {}:\n{text}", case.name, isa.name());
            assert_eq!(differs, None, "{} {}:\n{text}", case.name, isa.name());
            if isa == Isa::best() {
                write_stages(&case, &stages).expect("stages are written");
            }
        }
    }
}

fn write_stages(case: &Case, stages: &[Vec<f32>]) -> std::io::Result<()> {
    let path = scratch().join(format!("{}.npz", case.name));
    let mut file = NpzWriter::create(path)?;
    let mut write = |name: &str, values: &[f32]| {
        let shape: Vec<u64> = expected(case, name).shape.iter().map(|&n| n as u64).collect();
        let mut array = file.array(name, Default::default())?.default_dtype().shape(&shape).begin_nd()?;
        array.extend(values.iter().copied())?;
        array.finish()
    };
    let (layers, others): (Vec<_>, Vec<_>) =
        STAGES.iter().zip(stages).partition(|((name, _), _)| name.starts_with("d_layer_"));
    for ((name, _), values) in others {
        write(name, values)?;
    }
    // Forward order again, as one flat vector.
    let d_weights: Vec<f32> = layers.into_iter().rev().flat_map(|(_, values)| values.iter().copied()).collect();
    write("d_weights", &d_weights)
}

#[test]
fn a_fault_is_named_by_the_stage_it_is_in() {
    let case = Case::named("pipeline");
    let named = |fault: Fault| report(&case, &run(&case, Isa::best(), fault)).1;
    assert_eq!(named(Fault { features: true, ..Fault::default() }), Some("features"));
    for (layer, stage) in STAGES.iter().enumerate().skip(1).take(9) {
        assert_eq!(named(Fault { layer: Some(layer), ..Fault::default() }), Some(stage.0));
    }
    for channel in 0..16 {
        assert_eq!(named(Fault { parameter: Some(channel), ..Fault::default() }), Some("parameters"));
    }
    for layer in 2..=9 {
        let expected = format!("d_layer_{}", layer - 1);
        assert_eq!(named(Fault { layer_backward: Some(layer), ..Fault::default() }), Some(expected.as_str()));
    }
    assert_eq!(named(Fault { loss: true, ..Fault::default() }), Some("loss"));
}

#[test]
fn a_report_says_how_many_the_first_the_worst_and_where_the_map_is() {
    let case = Case::named("pipeline");
    let mut stages = run(&case, Isa::best(), Fault::default());
    // Half a, channel 1, row 2, column 3 and half b, channel 0, row 6, column 5 of layer 4.
    stages[4][7 * 6 + 2 * 6 + 3] += 0.25;
    stages[4][16 * 7 * 6 + 6 * 6 + 5] = f32::NAN;
    let (text, stage) = report(&case, &stages);
    assert_eq!(stage, Some("layer_4"));
    assert!(text.contains("layer_3: equal"), "{text}");
    assert!(text.contains("2 of 1344 values differ"), "{text}");
    assert!(text.contains("first at [0, 1, 2, 3]"), "{text}");
    assert!(text.contains("at [1, 0, 6, 5]"), "{text}");
    let path = text.split("error map: ").nth(1).expect("an error map").trim();
    assert!(Path::new(path).metadata().is_ok_and(|m| m.len() > 0), "{path}");
}
