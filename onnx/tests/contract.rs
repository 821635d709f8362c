//! Written models are read back unchanged, and other files are refused with the reason.

use sspc_core::prepare::Exposure;
use sspc_kernels::features::FeatureSet;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use sspc_onnx::*;
use std::collections::BTreeMap;

/// Weights that differ from each other, of a fitted network's magnitude.
fn model(form: Form, hidden: usize, layers: usize) -> Model {
    let mut contract = Contract::new(form);
    let shape = Shape { hidden, layers, outputs: form.parameters() };
    contract.shape = shape;
    contract.seed = 7;
    contract.steps = 300;
    contract.preset = "default".into();
    contract.tool = "sspc-train 0.1.0".into();
    contract.frames = vec!["shot/a.1001.exr".into(), "shot/a, take 2.1004.exr".into()];
    contract.features = FeatureSet { albedo: true, normal: true, visibility: false };
    contract.extra = BTreeMap::from([("loss".to_string(), "0.0123".to_string())]);
    let count = shape.parameter_count();
    let weights = (0..count).map(|i| ((i * 7919 % 1009) as f32 / 1009.0 - 0.5) * 0.2).collect();
    Model::new(contract, weights).unwrap()
}

fn small(form: Form) -> Model {
    model(form, 3, 3)
}

#[test]
fn all_graphs_give_the_model_back_to_the_bit() {
    for form in [Form::Paper, Form::Gated] {
        for (hidden, layers, radius) in [(16, 9, 9), (3, 3, 4), (1, 1, 12)] {
            let mut model = model(form, hidden, layers);
            model.contract.window_radius = radius;
            model.contract.exposure = if radius == 9 { Exposure::Normalised } else { Exposure::AsIs };
            let network = (write_network(&model), GraphKind::Network);
            let image = (write_image(&model), GraphKind::Image);
            let picture = (write_picture(&model), GraphKind::Picture);
            for (bytes, kind) in [network, image, picture, (write_operators(&model), GraphKind::Operators)] {
                assert_eq!(read_model(&bytes).unwrap(), model);
                assert_eq!(read_graph_kind(&bytes).unwrap(), kind);
            }
        }
    }
}

/// Networks of their own weights.
fn several(form: Form, networks: usize) -> Model {
    let Model { mut contract, weights } = small(form);
    contract.networks = networks;
    let of = |k: usize| weights.iter().map(move |w| w * (k + 1) as f32).collect::<Vec<f32>>();
    Model::new(contract, (0..networks).flat_map(of).collect()).unwrap()
}

#[test]
fn several_networks_come_back_in_their_order() {
    for (form, networks) in [(Form::Gated, 2), (Form::Paper, 3), (Form::Gated, MAX_NETWORKS)] {
        let model = several(form, networks);
        for bytes in [write_network(&model), write_image(&model), write_picture(&model), write_operators(&model)] {
            assert!(bytes.len() as u64 <= MAX_FILE_BYTES, "{} bytes", bytes.len());
            let found = read_model(&bytes).unwrap();
            assert_eq!(found, model);
            assert_eq!(found.networks().len(), networks);
            assert_eq!(found.of_network(1).weights[0], 2.0 * model.weights[0]);
        }
    }
}

#[test]
fn only_several_networks_need_the_second_version() {
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let (one, two) = (write_network(&several(Form::Gated, 1)), write_network(&several(Form::Gated, 2)));
    assert!(!text(&one).contains("sspc.networks") && text(&two).contains("sspc.networks"));
    assert_eq!((small(Form::Gated).contract.version(), several(Form::Gated, 2).contract.version()), (1, 2));
    let nan = Model { weights: vec![f32::NAN; several(Form::Gated, 2).weights.len()], ..several(Form::Gated, 2) };
    assert!(Model::new(nan.contract, nan.weights).is_err());
}

/// Fails when a model of differences passes for one that older readers know, or its weight is lost or not looked at.
#[test]
fn differences_need_the_fourth_version() {
    for (networks, extra_frames) in [(1, 0), (2, 0), (1, 1), (3, 2)] {
        let mut model = several(Form::Gated, networks);
        (model.contract.differences, model.contract.extra_frames) = (0.7, extra_frames);
        assert_eq!(model.contract.version(), 4);
        assert_eq!(read_model(&write_network(&model)).unwrap(), model);
    }
    let mut model = small(Form::Gated);
    model.contract.differences = 2.5;
    let bytes = write_network(&model);
    for wrong in [b"0.0", b"-.5", b"nan", b"1e9", b"abc"] {
        let bytes =
            altered(&bytes, b"sspc.differences\x12\x032.5", &[b"sspc.differences\x12\x03".as_slice(), wrong].concat());
        assert!(matches!(read_model(&bytes), Err(Error::Key { key, .. }) if key == "sspc.differences"), "{wrong:?}");
    }
}

#[test]
fn equal_models_give_equal_bytes() {
    let model = small(Form::Gated);
    assert_eq!(write_network(&model), write_network(&model.clone()));
}

#[test]
fn weights_that_do_not_fit_or_are_not_finite_are_refused() {
    let Model { contract, mut weights } = small(Form::Paper);
    let short = Model::new(contract.clone(), weights[1..].to_vec()).unwrap_err();
    assert!(matches!(short, Error::WeightCount { expected, found } if found + 1 == expected));
    weights[5] = f32::NAN;
    let nan = Model::new(contract, weights).unwrap_err();
    assert!(matches!(nan, Error::NotFinite { tensor, index: 5, .. } if tensor == "conv0.weight"));
}

/// A file with one occurrence of `from` replaced by bytes of the same length.
fn altered(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    assert_eq!(from.len(), to.len(), "lengths inside a protobuf file must not change");
    let at = bytes.windows(from.len()).position(|w| w == from).expect("text is in the file");
    let mut altered = bytes.to_vec();
    altered[at..at + to.len()].copy_from_slice(to);
    altered
}

#[test]
fn another_contract_is_named() {
    let bytes = write_network(&small(Form::Gated));
    let contract_entry = [b"sspc.contract\x12\x01".as_slice(), b"1"].concat();
    let later = altered(&bytes, &contract_entry, b"sspc.contract\x12\x019");
    assert!(matches!(read_model(&later), Err(Error::Version { found, .. }) if found == "9"));
    let second = altered(&bytes, &contract_entry, b"sspc.contract\x12\x012");
    assert!(matches!(read_model(&second), Err(Error::MissingKey { key }) if key == "sspc.networks"));

    let radius = altered(&bytes, b"sspc.window_radius\x12\x019", b"sspc.window_radius\x12\x010");
    assert!(matches!(read_model(&radius), Err(Error::Key { key, .. }) if key.contains("radius")));

    let order = altered(&bytes, b"radiance.R,radiance.G", b"radiance.G,radiance.R");
    assert!(matches!(read_model(&order), Err(Error::Key { key, .. }) if key.contains("input")));

    let form = altered(&bytes, b"gated", b"paper");
    assert!(matches!(read_model(&form), Err(Error::Key { key, .. }) if key.contains("output")));

    let foreign = altered(&bytes, b"sspc.contract", b"abcd.contract");
    assert!(matches!(read_model(&foreign), Err(Error::MissingKey { key }) if key == "sspc.contract"));
}

#[test]
fn sizes_are_checked_before_anything_is_copied() {
    let bytes = write_network(&model(Form::Paper, 16, 9));
    let wide = altered(&bytes, b"hidden_channels\x12\x0216", b"hidden_channels\x12\x0215");
    assert!(matches!(read_model(&wide), Err(Error::TensorShape { tensor, .. }) if tensor == "conv0.weight"));
    let zero = altered(&bytes, b"convolutions\x12\x019", b"convolutions\x12\x010");
    assert!(matches!(read_model(&zero), Err(Error::Key { key, .. }) if key == "sspc.convolutions"));
    let many = altered(&bytes, b"hidden_channels\x12\x0216", b"hidden_channels\x12\x0299");
    assert!(matches!(read_model(&many), Err(Error::Key { key, .. }) if key == "sspc.hidden_channels"));
    let huge = vec![0; MAX_FILE_BYTES as usize + 1];
    assert!(matches!(read_model(&huge), Err(Error::TooLarge { .. })));
}

#[test]
fn other_operators_and_constants_are_refused() {
    let bytes = write_network(&small(Form::Paper));
    let elu = altered(&bytes, b"\x22\x04Relu", b"\x22\x04Tanh");
    assert!(matches!(read_model(&elu), Err(Error::Operator { .. })));
    let floor = altered(&bytes, &1e-4f32.to_le_bytes(), &1e-2f32.to_le_bytes());
    assert!(matches!(read_model(&floor), Err(Error::Constant { tensor }) if tensor == "activation_floor"));
}

#[test]
fn a_non_finite_weight_in_a_file_is_found() {
    let model = small(Form::Paper);
    let weight = model.weights[3].to_le_bytes();
    let bytes = altered(&write_network(&model), &weight, &f32::INFINITY.to_le_bytes());
    assert!(matches!(read_model(&bytes), Err(Error::NotFinite { .. })));
}

#[test]
fn no_truncation_and_no_flipped_byte_is_a_panic() {
    let bytes = write_network(&small(Form::Gated));
    for length in 0..bytes.len() {
        assert!(read_model(&bytes[..length]).is_err(), "{length} of {} bytes", bytes.len());
    }
    let mut bytes = bytes;
    for at in 0..bytes.len() {
        let kept = bytes[at];
        for value in [0, 0xff, kept ^ 0x80] {
            bytes[at] = value;
            let _ = read_model(&bytes);
        }
        bytes[at] = kept;
    }
    assert!(read_model(b"v/1 \x01\x02 not a model").is_err());
    assert!(read_model(b"").is_err());
}
