//! `sspc-infer evaluate` as a person or a farm runs it.

use sspc_image::Image;
use sspc_testkit::exr_parts::write_mixed;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn sample(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample").join(name)
}

fn evaluate(arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
    command.arg("evaluate").args(arguments).output().expect("sspc-infer runs")
}

fn text(path: &Path) -> &str {
    path.to_str().expect("a path in UTF-8")
}

/// Exit code, and exactly two lines on standard error that hold the words; nothing on standard output.
fn assert_fails(output: &Output, code: i32, words: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{error}");
    assert!(output.stdout.is_empty());
    let lines: Vec<&str> = error.lines().collect();
    assert_eq!(lines.len(), 2, "{error}");
    assert!(lines[0].starts_with("error: ") && lines[1].starts_with("advice: "), "{error}");
    words.iter().for_each(|word| assert!(lines[0].contains(word), "'{word}' in {error}"));
}

#[test]
fn figures_are_printed_for_people() {
    let output = evaluate(&[
        text(&sample("a.exr")),
        "--reference",
        text(&sample("ref.exr")),
        "--denoised",
        text(&sample("denoised.exr")),
    ]);
    let table = String::from_utf8_lossy(&output.stdout);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(output.stderr.is_empty());
    for word in
        ["relL2", "brightness", "SMAPE", "PSNR", "SSIM", "FLIP", "picture", "denoised", "ratio", "256x192", "0.001852"]
    {
        assert!(table.contains(word), "'{word}' in\n{table}");
    }
}

#[test]
fn json_has_every_figure_and_an_error_map_is_written() {
    let folder = tempfile::tempdir().expect("folder");
    let map = folder.path().join("error.png");
    let output = evaluate(&[
        text(&sample("denoised.exr")),
        "--reference",
        text(&sample("ref.exr")),
        "--denoised",
        text(&sample("denoised.exr")),
        "--json",
        "--exposure",
        "1",
        "--error-map",
        text(&map),
    ]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    let near = |value: &serde_json::Value, expected: f64| {
        let found = value.as_f64().expect("a number");
        assert!((found / expected - 1.0).abs() < 1e-4, "{found} instead of {expected}");
    };
    near(&json["figures"]["rel_l2"], 0.001_851_655_15);
    near(&json["denoised"]["figures"]["rel_l2"], 0.001_851_655_15);
    near(&json["denoised"]["rel_l2_ratio"], 1.0);
    near(&json["denoised"]["crossed_ratio"], 1.0);
    assert_eq!(json["denoised"]["crossed_ratio_standard_error"], 0.0, "of a picture against itself");
    for figure in ["brightness", "smape", "psnr", "ssim", "flip", "pixels", "excluded", "rel_l2_standard_error"] {
        assert!(json["figures"][figure].is_number(), "{figure}");
    }
    assert_eq!(json["reference_noise_removed"], true);
    assert_eq!((&json["width"], &json["height"]), (&256.into(), &192.into()));
    assert!(std::fs::read(&map).expect("map").starts_with(b"\x89PNG"));
    assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 1, "nothing but the map");
}

#[test]
fn bad_input_is_code_3() {
    let folder = tempfile::tempdir().expect("folder");
    let reference = sample("ref.exr");
    let nowhere = folder.path().join("nowhere.exr");
    assert_fails(&evaluate(&[text(&nowhere), "--reference", text(&reference)]), 3, &["nowhere.exr", "no such file"]);
    let false_exr = folder.path().join("text.exr");
    std::fs::write(&false_exr, "not pixels").expect("written");
    assert_fails(
        &evaluate(&[text(&false_exr), "--reference", text(&reference)]),
        3,
        &["text.exr", "not an OpenEXR file"],
    );
    assert_fails(&evaluate(&[text(&reference), "--reference", text(&false_exr)]), 3, &["text.exr", "reference"]);
    let other = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/blender/denoised.exr");
    assert_fails(&evaluate(&[text(&other), "--reference", text(&reference)]), 3, &["ref.exr", "256x192", "96x64"]);
    let cut = folder.path().join("cut.exr");
    let whole = std::fs::read(sample("denoised.exr")).expect("sample");
    std::fs::write(&cut, &whole[..whole.len() / 2]).expect("written");
    assert_fails(&evaluate(&[text(&cut), "--reference", text(&reference)]), 3, &["cut.exr", "truncated or damaged"]);
}

#[test]
fn bad_arguments_are_code_2() {
    let (x, reference) = (sample("a.exr"), sample("ref.exr"));
    for arguments in [
        vec![text(&x)],
        vec![text(&x), "--reference", text(&reference), "--exposure", "-1"],
        vec![text(&x), "--reference", text(&reference), "--exposure", "nan"],
        vec![text(&x), "--reference", text(&reference), "--no-such-option"],
    ] {
        assert_eq!(evaluate(&arguments).status.code(), Some(2), "{arguments:?}");
    }
}

#[test]
fn outputs_that_cannot_be_written_are_code_4_and_leave_nothing() {
    let folder = tempfile::tempdir().expect("folder");
    let input = folder.path().join("x.exr");
    std::fs::copy(sample("denoised.exr"), &input).expect("copied");
    let before = std::fs::read(&input).expect("read");
    let reference = sample("ref.exr");
    let with_map = |map: &Path| evaluate(&[text(&input), "--reference", text(&reference), "--error-map", text(map)]);
    assert_fails(&with_map(&input), 4, &["x.exr", "an output that is no input"]);
    assert_fails(&with_map(&folder.path().join("no/such/folder.png")), 4, &["folder.png", "an existing folder"]);
    assert_fails(&with_map(folder.path()), 4, &["a folder"]);
    assert_eq!(std::fs::read(&input).expect("read"), before);
    assert_eq!(std::fs::read_dir(folder.path()).expect("folder").count(), 1);
}

#[cfg(unix)]
#[test]
fn a_closed_pipe_is_said_and_not_a_panic() {
    let (reader, writer) = std::io::pipe().expect("pipe");
    drop(reader);
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
    command.args(["evaluate", text(&sample("a.exr")), "--reference", text(&sample("ref.exr"))]);
    let child = command.stdout(writer).stderr(Stdio::piped()).spawn().expect("sspc-infer runs");
    assert_fails(&child.wait_with_output().expect("ended"), 4, &["standard output"]);
}

/// A light of 2 beside a light of 1: of a picture, a denoised picture and two halves of a reference.
#[test]
fn a_layer_is_measured_like_a_picture() {
    let folder = tempfile::tempdir().expect("folder");
    let file = |name: &str| folder.path().join(name);
    let flat = |value: f32| Image::filled(3, 12, 16, value);
    write_mixed(&file("x.exr"), &[("", "RGB", &flat(3.0), false), ("key light", "RGB", &flat(2.1), false)]);
    write_mixed(&file("z.exr"), &[("", "RGB", &flat(2.2), false)]);
    let halves: &[(&str, &str, &Image, bool)] = &[
        ("", "RGB", &flat(3.0), false),
        ("a.key light", "RGB", &flat(1.9), false),
        ("b.key light", "RGB", &flat(2.1), false),
    ];
    write_mixed(&file("ref.exr"), halves);
    let measure = |layer: &str| {
        let [x, z, r] = ["x.exr", "z.exr", "ref.exr"].map(file);
        evaluate(&[text(&x), "--reference", text(&r), "--denoised", text(&z), "--layer", layer, "--json"])
    };
    let output = measure("key light");
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert_eq!(found["reference_noise_removed"], true);
    // (2.1 - 2)² and (2.2 - 2)², less the reference's noise of 0.1², over 2² + 0.01.
    for (found, expected) in [(&found["figures"], 0.0), (&found["denoised"]["figures"], 0.03 / 4.01)] {
        let found = found["rel_l2"].as_f64().expect("a figure");
        assert!((found - expected).abs() < 1e-6, "{found}, not {expected}");
    }
    assert_fails(&measure("rim"), 3, &["x.exr", "the layer rim", "key light"]);
}
