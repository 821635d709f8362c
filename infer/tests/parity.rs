//! Both graphs against the PyTorch reference's cases, through tract with its own operators and with
//! ours.

use sspc_image::Image;
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::parameters::{Form, activation_f64};
use sspc_kernels::simd::Isa;
use sspc_onnx::{Contract, Model, write_image};
use sspc_testkit::case::Case;
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::method;
use tract_onnx::prelude::*;

/// The bound for the network: nine layers of f32 sums, then activations.
const NETWORK_TOLERANCE: f64 = 1e-4;
/// The bound for the picture.
const IMAGE_TOLERANCE: f64 = 1e-3;

fn kernels() -> Vec<(String, Kernels)> {
    let ours = Isa::available().into_iter().map(|isa| (isa.name().to_string(), Kernels::Fused(isa)));
    ours.chain([("tract".to_string(), Kernels::Tract)]).collect()
}

fn model_of(case: &Case, form: Form) -> Model {
    Model::new(Contract::new(form), case.any("weights").f32()).unwrap()
}

fn parameters(model: &Model, kernels: Kernels, features: &Image) -> Image {
    method::parameters(&Engine::new(model.clone(), kernels, 4), features)
}

#[test]
fn the_network_graph_gives_pytorchs_parameters() {
    let case = Case::named("network");
    let model = model_of(&case, Form::Paper);
    for (height, width) in [(1, 1), (1, 6), (7, 5), (11, 13)] {
        let features = case.any(&format!("features_{height}x{width}")).f32();
        let features = Image::from_planes(13, height, width, features);
        let raw = &case.any(&format!("raw_{height}x{width}")).values;
        let pixels = height * width;
        let expected = raw.iter().enumerate().map(|(i, o)| activation_f64(i / pixels, *o).0 as f32);
        let expected = Image::from_planes(15, height, width, expected.collect());
        for (name, kernels) in kernels() {
            let found = parameters(&model, kernels, &features);
            assert_images_close(&found, &expected, NETWORK_TOLERANCE, &format!("{name}, {height}x{width}"));
        }
    }
}

#[test]
fn the_network_graph_gives_the_pipelines_parameters() {
    let case = Case::named("pipeline");
    let model = model_of(&case, Form::Gated);
    for half in 0..2 {
        let features = case.any("features").image(half);
        let expected = case.any("parameters").image(half);
        for (name, kernels) in kernels() {
            let found = parameters(&model, kernels, &features);
            assert_images_close(&found, &expected, NETWORK_TOLERANCE, &format!("{name}, half {half}"));
        }
    }
}

#[test]
fn the_image_graph_gives_pytorchs_picture_in_tract() {
    let case = Case::named("pipeline");
    let bytes = write_image(&model_of(&case, Form::Gated));
    let names = ["radiance", "denoised", "albedo", "visibility", "normal"];
    let mut graph = tract_onnx::onnx().model_for_read(&mut &bytes[..]).unwrap();
    let mut inputs: TVec<TValue> = tvec!();
    for (i, name) in names.into_iter().enumerate() {
        let array = case.any(name);
        graph = graph.with_input_fact(i, f32::fact(&array.shape).into()).unwrap();
        inputs.push(Tensor::from_shape(&array.shape, &array.f32()).unwrap().into());
    }
    inputs.push(tensor1(&[1.0f32]).into());
    let outputs = graph.into_optimized().unwrap().into_runnable().unwrap().run(inputs).unwrap();
    let halves = outputs[1].to_plain_array_view::<f32>().unwrap();
    let halves: Vec<f32> = halves.iter().copied().collect();
    for half in 0..2 {
        let expected = case.any("mu_hat").image(half);
        let pixels = 3 * expected.pixels();
        let found = halves[half * pixels..][..pixels].to_vec();
        let found = Image::from_planes(3, expected.height(), expected.width(), found);
        assert_images_close(&found, &expected, IMAGE_TOLERANCE, &format!("half {half}"));
    }
    let corrected = outputs[0].to_plain_array_view::<f32>().unwrap();
    for (i, c) in corrected.iter().enumerate() {
        let mean = 0.5 * (halves[i] + halves[halves.len() / 2 + i]);
        assert!((c - mean.max(0.0)).abs() <= 1e-6 * mean.abs().max(1.0), "mean of halves at {i}");
    }
}
