//! `sspc-train fit` on a shot as a user runs it.

use sspc_onnx::load_model;
use sspc_testkit::made_shot::MadeFrame;
use std::path::Path;
use std::process::{Command, Output};

fn fit(folder: &Path, more: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-train"));
    command.current_dir(folder).args(["fit", "--a", "a.####.exr", "--b", "b.####.exr", "--steps", "2", "-o", "out"]);
    command.args(more).output().expect("sspc-train runs")
}

fn report(folder: &Path, name: &str) -> serde_json::Value {
    let text = std::fs::read_to_string(folder.join("out").join(name)).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

#[test]
fn a_shot_is_fitted_with_its_neighbours_and_the_model_says_so() {
    let folder = tempfile::tempdir().expect("folder");
    (1..=4).for_each(|number| drop(MadeFrame::new(number).write(folder.path())));
    let output = fit(folder.path(), &["--frames", "2-3"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("motion to the previous frame: +X -Y pixels"), "{said}");
    // All move alike, so both pairs lead to the next frame.
    assert!(said.contains("motion to the next frame: -X +Y pixels"), "{said}");
    let contract = load_model(&folder.path().join("out/model.onnx")).expect("a model").contract;
    assert_eq!(contract.extra_frames, 1);
    assert_eq!(contract.extra["motion.previous"], "+X -Y pixels");
    // Neighbours outside of the range are read.
    let frames: Vec<i64> = report(folder.path(), "report.2.json")["neighbours"]
        .as_array()
        .expect("neighbours")
        .iter()
        .filter_map(|neighbour| neighbour["frame"].as_i64())
        .collect();
    assert_eq!(frames, [1, 3]);
}

#[test]
fn a_shot_of_one_frame_is_a_frame() {
    let folder = tempfile::tempdir().expect("folder");
    MadeFrame::new(7).write(folder.path());
    for more in [&["--frames", "7"][..], &["--frames", "7", "--extra-frames", "0"]] {
        let output = fit(folder.path(), more);
        assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
        let contract = load_model(&folder.path().join("out/model.onnx")).expect("a model").contract;
        assert_eq!(contract.extra_frames, 0);
    }
    let output = fit(folder.path(), &["--frames", "7", "--extra-frames", "5"]);
    assert_eq!(output.status.code(), Some(2));
}

#[test]
fn a_long_shot_is_fitted_to_some_of_its_frames() {
    let folder = tempfile::tempdir().expect("folder");
    (1..=20).for_each(|number| drop(MadeFrame { size: (48, 64), ..MadeFrame::new(number) }.write(folder.path())));
    let output = fit(folder.path(), &["--frames", "1-20"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{said}");
    assert!(said.contains("fits to 8 of 20 frames: 1, 3, 6, 9, 11, 14, 17, 20"), "{said}");
    let exists = |name: &str| folder.path().join("out").join(name).exists();
    assert!(exists("corrected.20.exr") && !exists("corrected.2.exr"));
}
