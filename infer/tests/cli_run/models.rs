//! Models that are told, refused, unlike the frame, or without effect.

use super::*;

#[test]
fn bad_models_give_code_3_and_say_why() {
    let folder = shot();
    let good = write_network(&start_model());
    let later = {
        let at = good.windows(15).position(|w| w == b"sspc.contract\x12\x01").expect("entry");
        let mut bytes = good.clone();
        bytes[at + 15] = b'7';
        bytes
    };
    let cases: [(&[u8], &str); 4] = [
        (b"no model", "not an ONNX file"),
        (&good[..good.len() - 100], "model.onnx: "),
        (&later, "contract version 7"),
        (b"", "no graph"),
    ];
    for (bytes, words) in cases {
        std::fs::write(folder.path().join("model.onnx"), bytes).expect("model");
        let output = run(folder.path(), &["a.0001.exr", "b.0001.exr", "-o", "out/c.exr"]);
        assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
        assert!(stderr(&output).contains(words), "{words}: {}", stderr(&output));
        assert!(files_in(&folder.path().join("out")).is_empty());
    }
}

#[test]
fn info_says_what_a_model_is() {
    let folder = shot();
    std::fs::write(folder.path().join("image.onnx"), write_image(&start_model())).expect("model");
    for (file, graph) in [("model.onnx", "network: features"), ("image.onnx", "image: the half buffers")] {
        let output = Command::new(env!("CARGO_BIN_EXE_sspc-infer"))
            .current_dir(folder.path())
            .args(["info", file])
            .output()
            .expect("sspc-infer runs");
        let said = String::from_utf8_lossy(&output.stdout);
        assert_eq!(output.status.code(), Some(0));
        for words in [graph, "20448 weights", "19x19 pixels", "kitchen.1001.exr", "normalised", "version 1"] {
            assert!(said.contains(words), "'{words}' in\n{said}");
        }
    }
}

/// A model of constant parameters: slopes of z at -1 over the widest windows, which takes away what detail the denoiser
/// left, behind a gate of this output before activation.
fn bad_model(gate: f32) -> Model {
    let contract = Contract::new(Form::Gated);
    let mut weights = vec![0.0; contract.shape.parameter_count()];
    let biases = weights.len() - 16;
    // Outputs before activation: see onnx/README.md.
    let raw = [[-9.0; 3], [0.0; 3], [0.0; 3]].concat().into_iter().chain([90.0; 5]).chain([-9.0, gate]);
    raw.enumerate().for_each(|(i, o)| weights[biases + i] = o);
    Model::new(contract, weights).expect("a model")
}

#[test]
fn a_frame_unlike_those_fitted_on_is_noticed_and_not_made_worse() {
    let folder = shot();
    let full = sample("denoised.exr");
    let arguments =
        ["a.0001.exr", "b.0001.exr", "-o", "out/c.exr", "--json", "--denoised", full.to_str().expect("UTF-8")];
    let good = run(folder.path(), &arguments);
    let said_of_good = report(&folder.path().join("out/c.json"));
    assert!(said_of_good.get("unlike").is_none() && !stderr(&good).contains("unlike"), "{}", stderr(&good));

    std::fs::write(folder.path().join("model.onnx"), write_network(&bad_model(9.0))).expect("model");
    let bad = run(folder.path(), &arguments);
    assert_eq!(bad.status.code(), Some(0), "{}", stderr(&bad));
    assert!(stderr(&bad).contains("unlike those that the model was fitted on"), "{}", stderr(&bad));
    let said = report(&folder.path().join("out/c.json"));
    assert!(said["unlike"].is_string(), "{said}");
    let loss = |of: &str| said["loss"][of].as_f64().expect(of);
    assert!(said["model_loss"].as_f64().expect("a loss") > 1.2 * loss("denoised"), "{said}");
    assert!(loss("corrected") <= loss("denoised"), "{said}");
    // What is wrong was cut away by the judgement: the true error tells.
    let reference = read_reference(&sample("ref.exr"), None).expect("reference");
    let error = |path: &Path| rel_l2(&picture(path), &reference).value;
    let (ours, denoiser) = (error(&folder.path().join("out/c.exr")), error(&sample("denoised.exr")));
    assert!(ours <= 1.01 * denoiser, "relL2 {ours} after {denoiser}");
}

#[test]
fn a_model_that_changes_nothing_leaves_the_denoisers_picture_bit_for_bit() {
    let folder = shot();
    std::fs::write(folder.path().join("model.onnx"), write_network(&bad_model(-200.0))).expect("model");
    let full = sample("denoised.exr");
    let arguments =
        ["a.0001.exr", "b.0001.exr", "-o", "out/c.exr", "--json", "--denoised", full.to_str().expect("UTF-8")];
    let output = run(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert!(stderr(&output).contains("the picture is the denoiser's"), "{}", stderr(&output));
    let said = report(&folder.path().join("out/c.json"));
    assert!(said["fallback"].is_string() && said["mean_share"] == 0.0, "{said}");
    let bits = |path: &Path| picture(path).data().iter().map(|v| v.to_bits()).collect::<Vec<u32>>();
    assert!(bits(&folder.path().join("out/c.exr")) == bits(&full), "another picture");
}
