//! `sspc-train fit --set` as a user runs it, on the repository's sample.

use sspc_core::frame_stats::FrameStats;
use sspc_core::prepare::{Exposure, Prepared};
use sspc_kernels::parameters::{Form, SLOPES};
use sspc_testkit::frames;
use sspc_testkit::method::{parameters, window_network};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample").join(name)
}

fn fit(out: &Path, changes: &[&str]) -> Output {
    let changes = changes.iter().flat_map(|change| ["--set", change]);
    Command::new(env!("CARGO_BIN_EXE_sspc-train"))
        .stdin(Stdio::null())
        .arg("fit")
        .args([sample("a.exr"), sample("b.exr")])
        .args(["--steps", "3", "--quiet", "-o"])
        .arg(out)
        .args(changes)
        .output()
        .expect("sspc-train starts")
}

fn report(out: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(out.join("report.json")).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn changed_settings_are_in_force_and_told() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out");
    let changes = ["window=7", "hidden=4", "layers=3", "gate=none", "influence=inf", "tile=24", "batch=2", "skip=none"];
    let output = fit(&out, &changes);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report = report(&out);
    let settings = &report["settings"];
    assert_eq!(settings["network"], serde_json::json!({ "hidden": 4, "layers": 3, "outputs": 15 }));
    assert_eq!((&settings["window_radius"], &settings["form"]), (&3.into(), &"paper".into()));
    assert_eq!((&settings["tile"], &settings["batch"]), (&24.into(), &2.into()));
    assert!(settings["influence"].is_null());
    assert_eq!(settings["changed"], serde_json::json!(changes));
    let contract = sspc_onnx::load_model(&out.join("model.onnx")).expect("a model").contract;
    assert_eq!((contract.window_radius, contract.shape.hidden, contract.form), (3, 4, Form::Paper));
    assert_eq!(contract.extra["settings_changed"], changes.join(" "));
}

/// Fails when a gradient reaches the slopes, or their start is not exact in f32.
#[test]
fn a_model_of_f_c_has_its_slopes() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out");
    let output = fit(&out, &["combination=fc"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(report(&out)["settings"]["combination"], "fc");
    let sample = frames::sample();
    let prepared = Prepared::by_stats(&sample, &FrameStats::of(&sample, Exposure::Normalised));
    let network = sspc_onnx::load_model(&out.join("model.onnx")).expect("a model").networks().remove(0);
    let planes = parameters(&window_network(Form::Gated, &network), &prepared.halves[0]);
    for slope in SLOPES..9 {
        let expected = if slope < 3 { 1.0 } else { 0.0 };
        assert!(planes.plane(slope).iter().all(|v| *v == expected), "slope {slope}");
    }
}

/// Skips change what is computed, not the picture: the sample has no still block, and its features
/// all vary, so both pictures are the same to the bit.
#[test]
fn skips_off_give_the_same_picture_where_nothing_is_skipped() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let pictures = ["all", "none"].map(|skip| {
        let out = folder.path().join(skip);
        let output = fit(&out, &[&format!("skip={skip}")]);
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        sspc_frames::read_picture(&out.join("corrected.exr"), None).expect("a picture")
    });
    assert_eq!(pictures[0], pictures[1]);
}

#[test]
fn a_wrong_setting_ends_with_2_and_says_what_is_allowed() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out");
    for (change, expected) in [("window=8", "odd, 3 to 25"), ("colour=red", "no such setting"), ("gate", "KEY=VALUE")] {
        let output = fit(&out, &[change]);
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{change}: {message}");
        assert!(message.contains(expected), "{change}: {message}");
    }
    assert!(!out.exists());
}

#[test]
fn help_names_every_key() {
    let output = Command::new(env!("CARGO_BIN_EXE_sspc-train")).args(["fit", "--help"]).output().expect("it starts");
    let help = String::from_utf8_lossy(&output.stdout).into_owned();
    let about = help.split_once("--set ").expect("--set").1;
    for (key, _) in sspc_train::setting_overrides::KEYS {
        assert!(about.contains(key), "{key}: {about}");
    }
}

#[test]
fn an_unknown_instruction_set_ends_with_2_and_names_the_known_ones() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-train"));
    command.arg("fit").args([sample("a.exr"), sample("b.exr")]).arg("-o").arg(&out).env("SSPC_ISA", "avx3");
    let output = command.output().expect("sspc-train starts");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("SSPC_ISA: expected ") && message.contains("portable, found \"avx3\""), "{message}");
    assert!(!out.exists());
}
