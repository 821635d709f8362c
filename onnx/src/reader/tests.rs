//! Hostile model files: every test fails when the check it is named after is removed.

use super::*;
use crate::builder::int;
use crate::messages::StringStringEntryProto;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;

fn small() -> Model {
    let mut contract = Contract::new(Form::Gated);
    contract.shape = Shape { hidden: 2, layers: 2, outputs: Form::Gated.parameters() };
    let weights = (0..contract.shape.parameter_count()).map(|i| (i % 7) as f32 * 0.1 - 0.3).collect();
    Model::new(contract, weights).expect("a model")
}

/// The network graph of the small model after a change of its messages.
fn changed(change: impl FnOnce(&mut ModelProto)) -> Vec<u8> {
    let mut file = ModelProto::decode(&write_network(&small())[..]).expect("our own");
    change(&mut file);
    file.encode_to_vec()
}

fn graph(file: &mut ModelProto) -> &mut GraphProto {
    file.graph.as_mut().expect("our own graph")
}

fn tensor<'a>(file: &'a mut ModelProto, name: &str) -> &'a mut TensorProto {
    graph(file).initializer.iter_mut().find(|t| t.name.as_deref() == Some(name)).expect(name)
}

fn refusal(change: impl FnOnce(&mut ModelProto)) -> Error {
    read_model(&changed(change)).expect_err("a changed model is refused")
}

fn entry(key: &str, value: &str) -> StringStringEntryProto {
    StringStringEntryProto { key: Some(key.into()), value: Some(value.into()) }
}

#[test]
fn an_unchanged_model_is_taken() {
    assert_eq!(read_model(&changed(|_| {})).expect("our own"), small());
}

#[test]
fn a_model_that_cuts_radiance_off_at_0_is_taken() {
    let earlier = crate::contract::earlier_exposure_rule(small().contract.exposure);
    assert!(earlier.contains("the scale, clamped at 0"), "{earlier}");
    let file = changed(|file| {
        let rule = file.metadata_props.iter_mut().find(|entry| entry.key.as_deref() == Some("sspc.exposure_rule"));
        rule.expect("a rule").value = Some(earlier);
    });
    assert_eq!(read_model(&file).expect("an earlier model"), small());
}

#[test]
fn more_than_the_limit_is_not_even_decoded() {
    let padded = |size: usize| {
        changed(|file| {
            let rest = size - file.encoded_len();
            // The field's own key and length, which grow with it.
            let doc = file.doc_string.clone().unwrap_or_default().len();
            file.doc_string = Some("x".repeat(rest + doc - 2));
        })
    };
    let limit = MAX_FILE_BYTES as usize;
    assert!(padded(limit).len() <= limit && read_model(&padded(limit)).is_ok());
    let error = read_model(&padded(limit + 8)).expect_err("too large");
    assert!(matches!(error, Error::TooLarge { found, limit: MAX_FILE_BYTES } if found > MAX_FILE_BYTES), "{error}");
}

#[test]
fn of_a_huge_file_only_the_limit_is_read() {
    let path = std::env::temp_dir().join(format!("sspc-huge-{}.onnx", std::process::id()));
    // A hole: the file takes no room, but reading it whole would take 64 GiB of memory.
    std::fs::File::create(&path).and_then(|file| file.set_len(64 << 30)).expect("a file with a hole");
    let outcome = load_model(&path);
    std::fs::remove_file(&path).expect("removed");
    let error = outcome.expect_err("too large");
    assert!(matches!(&error, FileError::Model { source: Error::TooLarge { .. }, .. }), "{error}");
}

#[cfg(unix)]
#[test]
fn a_device_is_refused_and_not_read_for_ever() {
    let error = load_model(Path::new("/dev/zero")).expect_err("a device");
    assert!(matches!(&error, FileError::Io { .. }) && error.to_string().contains("not a regular file"), "{error}");
}

#[test]
fn data_in_other_files_is_refused_wherever_it_is_named() {
    let location = || vec![entry("location", "../../etc/passwd")];
    let by_place = refusal(|file| {
        let weight = tensor(file, "conv0.weight");
        (weight.data_location, weight.raw_data) = (Some(EXTERNAL), None);
    });
    assert!(matches!(by_place, Error::ExternalData { ref tensor } if tensor == "conv0.weight"), "{by_place}");
    // Beside data of its own it would be ignored here and followed elsewhere.
    let by_name = refusal(|file| tensor(file, "conv1.bias").external_data = location());
    assert!(matches!(by_name, Error::ExternalData { ref tensor } if tensor == "conv1.bias"), "{by_name}");
    let constant = refusal(|file| tensor(file, "activation_floor").external_data = location());
    assert!(matches!(constant, Error::Constant { .. }), "{constant}");
    let unused = refusal(|file| {
        let extra = TensorProto { name: Some("more".into()), external_data: location(), ..Default::default() };
        graph(file).initializer.push(extra);
    });
    assert!(matches!(unused, Error::TensorCount { .. }), "{unused}");
}

#[test]
fn shapes_are_compared_before_anything_is_made_of_them() {
    for dims in [
        vec![i64::MAX, i64::MAX, 3, 3],
        vec![1_000_000_000, 1_000_000_000],
        vec![-2, 13, 3, 3],
        vec![13, 2, 3, 3],
        vec![],
        vec![2; 500_000],
    ] {
        let error = refusal(|file| tensor(file, "conv0.weight").dims.clone_from(&dims));
        let Error::TensorShape { tensor, expected, found } = &error else { panic!("{dims:?}: {error}") };
        assert_eq!((tensor.as_str(), expected.as_slice()), ("conv0.weight", [2, 13, 3, 3].as_slice()));
        // What is said of a shape of half a million dimensions is one line.
        assert!(found.len() <= 8 && error.to_string().len() < 400, "{}", error.to_string().len());
    }
}

#[test]
fn values_are_as_many_as_the_shape_says() {
    let count = 2 * 13 * 9;
    let with = |raw: Option<usize>, floats: usize| {
        refusal(|file| {
            let weight = tensor(file, "conv0.weight");
            weight.raw_data = raw.map(|bytes| vec![0; bytes]);
            weight.float_data = vec![0.0; floats];
        })
    };
    for (raw, floats) in [
        (None, 0),
        (None, count - 1),
        (None, count + 1),
        (Some(0), 0),
        (Some(4 * count - 1), 0),
        (Some(4 * count + 1), 0),
        (Some(4 * count), count),
        (Some(4 * count), 1),
    ] {
        let error = with(raw, floats);
        assert!(
            matches!(error, Error::TensorSize { ref tensor, expected, .. } if tensor == "conv0.weight" && expected == count),
            "{raw:?} {floats}: {error}"
        );
    }
}

#[test]
fn both_places_for_values_are_read() {
    let bytes = changed(|file| {
        let weight = tensor(file, "conv0.weight");
        let raw = weight.raw_data.take().expect("raw");
        weight.float_data = raw.as_chunks::<4>().0.iter().map(|quad| f32::from_le_bytes(*quad)).collect();
    });
    assert_eq!(read_model(&bytes).expect("ONNX allows it"), small());
}

#[test]
fn other_element_types_are_refused() {
    // FLOAT16, DOUBLE, BFLOAT16, none, out of range.
    for kind in [Some(10), Some(11), Some(16), None, Some(-1), Some(i32::MAX)] {
        let error = refusal(|file| tensor(file, "conv1.weight").data_type = kind);
        assert!(matches!(error, Error::TensorType { ref tensor, .. } if tensor == "conv1.weight"), "{kind:?}: {error}");
    }
}

#[test]
fn sizes_outside_the_contract_are_refused_by_their_key() {
    for (key, values) in [
        ("sspc.hidden_channels", ["0", "17", "18446744073709551616", "-1"]),
        ("sspc.convolutions", ["0", "33", "99999999999999999999", "two"]),
        ("sspc.window_radius", ["0", "13", "4294967296", ""]),
        ("sspc.seed", ["-1", "1e9", "18446744073709551616", " 1"]),
    ] {
        for value in values {
            let error = refusal(|file| {
                let entry = file.metadata_props.iter_mut().find(|e| e.key.as_deref() == Some(key)).expect(key);
                entry.value = Some(value.into());
            });
            assert!(matches!(error, Error::Key { key: ref named, .. } if named == key), "{key} = {value}: {error}");
        }
    }
}

#[test]
fn what_a_file_says_is_shown_in_one_line() {
    let hostile = "1\u{1b}[2J\n".repeat(10_000);
    for key in ["sspc.contract", "sspc.form", "sspc.features", "sspc.padding", "sspc.steps"] {
        let error = refusal(|file| {
            let entry = file.metadata_props.iter_mut().find(|e| e.key.as_deref() == Some(key)).expect(key);
            entry.value = Some(hostile.clone());
        });
        let line = error.to_string();
        assert!(line.len() < 2_000 && !line.chars().any(char::is_control), "{key}: {} bytes", line.len());
    }
    let error = refusal(|file| graph(file).node[0].op_type = Some(hostile.clone()));
    assert!(!error.to_string().chars().any(char::is_control), "{error}");
}

#[test]
fn a_graph_that_computes_something_else_is_refused() {
    let tensors = refusal(|file| {
        let twin = tensor(file, "conv0.weight").clone();
        graph(file).initializer.push(twin);
    });
    assert!(matches!(tensors, Error::TensorCount { .. }), "{tensors}");
    let output = refusal(|file| graph(file).output[0].name = Some("tau".into()));
    assert!(matches!(output, Error::Interface { .. }), "{output}");
    let domain = refusal(|file| graph(file).node[1].domain = Some("com.example".into()));
    assert!(matches!(domain, Error::Operator { index: 1, .. }), "{domain}");
    let padding = refusal(|file| graph(file).node[0].attribute[1] = int("group", 1));
    assert!(matches!(padding, Error::Operator { index: 0, .. }), "{padding}");
    let order = refusal(|file| graph(file).node.swap(0, 1));
    assert!(matches!(order, Error::Operator { index: 0, .. }), "{order}");
    let more = refusal(|file| {
        let last = graph(file).node.last().expect("nodes").clone();
        graph(file).node.push(last);
    });
    assert!(matches!(more, Error::Operator { .. }), "{more}");
}

/// Subgraphs in subgraphs: decoding must not run out of stack.
#[test]
fn deep_nesting_is_refused() {
    let mut inner = Vec::new();
    while inner.len() < 60_000 {
        // GraphProto.node (1) of NodeProto.attribute (5) of AttributeProto.g (6), each with its length.
        for field in [6, 5, 1] {
            let mut outer = vec![field << 3 | 2];
            prost::encoding::encode_varint(inner.len() as u64, &mut outer);
            outer.append(&mut inner);
            inner = outer;
        }
    }
    let mut bytes = vec![7 << 3 | 2];
    prost::encoding::encode_varint(inner.len() as u64, &mut bytes);
    bytes.append(&mut inner);
    assert!(matches!(read_model(&bytes), Err(Error::NotOnnx(_))));
}
