//! The network: raw outputs and weight gradients.

use sspc_image::Image;
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_kernels::network::{Network, Shape, WindowNetwork};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_testkit::case::Case;
use sspc_testkit::closeness::{Relative, assert_close, assert_sensitive, compare, largest};
use sspc_testkit::kernels::Pass;
use sspc_testkit::method::parameters;

/// Nine layers of 117 to 144 products each; of the largest output, since an output near zero is a
/// difference of large sums.
const FORWARD: f64 = 1e-5;
/// Of the largest gradient of the layer.
const GRADIENT: f64 = 1e-4;

fn sizes(case: &Case) -> Vec<(String, usize, usize)> {
    let sizes = case.facts["sizes"].as_array().expect("sizes of the network case");
    let text = |v: &serde_json::Value| v.as_str().expect("HxW").to_string();
    let parse = |s: String| {
        let (height, width) = s.split_once('x').expect("HxW");
        let (height, width) = (height.parse().expect("H"), width.parse().expect("W"));
        (s, height, width)
    };
    sizes.iter().map(text).map(parse).collect()
}

#[test]
fn raw_outputs_match_on_every_size() {
    for case in Case::of_kind("network") {
        let shape = Shape::paper(Form::Paper);
        let weights = case.get("weights", &[shape.parameter_count()]).f32();
        for (size, height, width) in sizes(&case) {
            let features = case.get(&format!("features_{size}"), &[FEATURE_CHANNELS, height, width]).f32();
            let expected = case.get(&format!("raw_{size}"), &[15, height, width]);
            for isa in Isa::available() {
                let stage = format!("{} {size} {} raw", case.name, isa.name());
                let found = Pass::forward(isa, &shape, &weights, &features, height, width).outputs;
                let worst = assert_close(&stage, expected, &found, Relative::ToScale(largest(expected)), FORWARD);
                println!("{stage}: worst {:.1e}", worst.0);
            }
        }
    }
}

/// The path of the correction: activated parameters of a picture, in windows with a halo.
#[test]
fn activated_parameters_of_a_picture_match() {
    for case in Case::of_kind("pipeline") {
        let shape = Shape::paper(Form::Gated);
        let (height, width) = case.size("features");
        let weights = case.get("weights", &[shape.parameter_count()]).f32();
        let network = Network { shape, weights };
        for half in 0..2 {
            let features = case.get("features", &[2, FEATURE_CHANNELS, height, width]).slab(half, half + 1).f32();
            let image = Image::from_planes(FEATURE_CHANNELS, height, width, features);
            let expected = case.get("parameters", &[2, 16, height, width]).slab(half, half + 1);
            for isa in Isa::available() {
                let stage = format!("{} half {half} {} parameters", case.name, isa.name());
                let found = parameters(&WindowNetwork::new(isa, Form::Gated, &network), &image);
                let worst =
                    assert_close(&stage, &expected, found.data(), Relative::ToScale(largest(&expected)), FORWARD);
                println!("{stage}: worst {:.1e}", worst.0);
            }
        }
    }
}

#[test]
fn weight_gradients_match_in_every_layer() {
    for case in Case::of_kind("network") {
        let shape = Shape::paper(Form::Paper);
        let count = shape.parameter_count();
        let weights = case.get("weights", &[count]).f32();
        let expected = case.get("d_weights", &[count]);
        for isa in Isa::available() {
            let mut total = vec![0.0; count];
            for (size, height, width) in sizes(&case) {
                let features = case.get(&format!("features_{size}"), &[FEATURE_CHANNELS, height, width]).f32();
                let upstream = case.get(&format!("upstream_{size}"), &[15, height, width]).f32();
                let gradient = Pass::forward(isa, &shape, &weights, &features, height, width).backward(&upstream);
                total.iter_mut().zip(gradient).for_each(|(t, g)| *t += g);
            }
            for layer in 0..shape.layers {
                let (start, length) = (shape.layer_start(layer), shape.layer_len(layer));
                let stage = format!("{} {} d_weights of layer {}", case.name, isa.name(), layer + 1);
                let (part, found) = (expected.slab(start, start + length), &total[start..start + length]);
                let worst = assert_close(&stage, &part, found, Relative::ToScale(largest(&part)), GRADIENT);
                println!("{stage}: worst {:.1e}", worst.0);
            }
        }
    }
}

/// What a wrong weight or bias of any layer would do: each layer's weights scaled, one after another.
#[test]
fn a_wrong_layer_is_caught() {
    let case = Case::named("network");
    let shape = Shape::paper(Form::Paper);
    let weights = case.get("weights", &[shape.parameter_count()]).f32();
    let features = case.get("features_7x5", &[FEATURE_CHANNELS, 7, 5]).f32();
    let expected = case.get("raw_7x5", &[15, 7, 5]);
    for layer in 0..shape.layers {
        let (start, length) = (shape.layer_start(layer), shape.layer_len(layer));
        assert_sensitive(&format!("network, layer {}", layer + 1), |error| {
            let mut moved = weights.clone();
            moved[start..start + length].iter_mut().for_each(|w| *w *= 1.0 + error as f32);
            let found = Pass::forward(Isa::best(), &shape, &moved, &features, 7, 5).outputs;
            compare("perturbed", expected, &found, Relative::ToScale(largest(expected)), FORWARD).is_err()
        });
    }
}
