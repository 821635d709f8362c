//! Shots, and models that other fits start from.

use crate::{assert_success, command, fit, folder, report, sample};
use std::path::Path;

#[test]
fn a_model_starts_another_fit_and_exports_both_graphs() {
    let folder = folder();
    let (first, second) = (folder.path().join("first"), folder.path().join("second"));
    assert_success(&fit(&first, &[]));
    let model = first.join("model.onnx");
    assert_success(&fit(&second, &["--init", model.to_str().expect("UTF-8")]));
    // The same seed, and so the same tiles: only the start can make the first step's loss another one.
    assert_ne!(report(&second)["history"][0]["loss"], report(&first)["history"][0]["loss"]);
    // Refined in place: the old model is replaced by what it would have become elsewhere.
    let refined = folder.path().join("refined");
    assert_success(&fit(&refined, &[]));
    let own = refined.join("model.onnx");
    assert_success(&fit(&refined, &["--init", own.to_str().expect("UTF-8")]));
    let read = |folder: &Path| std::fs::read(folder.join("model.onnx")).expect("a model");
    assert!(read(&refined) == read(&second) && read(&refined) != read(&first), "another model");
    for graph in ["network", "image", "picture"] {
        let out = folder.path().join(graph).with_extension("onnx");
        let output = command()
            .arg("export")
            .arg(&first)
            .arg("-o")
            .arg(&out)
            .args(["--graph", graph])
            .output()
            .expect("it starts");
        assert_success(&output);
        assert!(std::fs::metadata(&out).expect("a graph").len() > 20_000);
    }
    let wrong = sample("a.exr");
    let output = fit(&folder.path().join("third"), &["--init", wrong.to_str().expect("UTF-8")]);
    assert_eq!(output.status.code(), Some(3), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn a_shot_trains_one_model_on_several_frames() {
    let folder = folder();
    for (frame, half) in [(7, "a"), (7, "b"), (9, "a"), (9, "b")] {
        std::fs::copy(sample(&format!("{half}.exr")), folder.path().join(format!("{half}.{frame:04}.exr")))
            .expect("copied");
    }
    let out = folder.path().join("out");
    let pattern = |half: &str| folder.path().join(format!("{half}.####.exr"));
    let output = command()
        .args(["fit", "--frames", "7-9x2", "--steps", "2", "--a"])
        .arg(pattern("a"))
        .arg("--b")
        .arg(pattern("b"))
        .arg("-o")
        .arg(&out)
        .output()
        .expect("sspc-train starts");
    assert_success(&output);
    for name in ["model.onnx", "corrected.7.exr", "corrected.9.exr", "report.7.json", "report.9.json"] {
        assert!(out.join(name).exists(), "{name} is missing");
    }
}

/// Whatever `run` takes, `fit` takes: a shot whose files hold both halves each.
#[test]
fn a_shot_with_both_halves_in_one_file_can_be_fitted() {
    use sspc_testkit::exr_parts::write_file;
    let folder = folder();
    let layers = ["R", "G", "B", "denoised.R", "denoised.G", "denoised.B"];
    let names: Vec<String> = ["a", "b"].iter().flat_map(|half| layers.map(|layer| format!("{half}.{layer}"))).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    for frame in 1..=2 {
        write_file(&folder.path().join(format!("both.{frame:04}.exr")), frame, &names);
    }
    let out = folder.path().join("fit");
    let done = command()
        .arg("fit")
        .arg("--a")
        .arg(folder.path().join("both.####.exr"))
        .args(["--frames", "1-2", "--steps", "2", "-o"])
        .arg(&out)
        .output()
        .expect("sspc-train starts");
    assert_success(&done);
    assert!(out.join("corrected.1.exr").exists() && out.join("corrected.2.exr").exists());
}
