//! NaN and Inf in files, as a user meets them: counted, said, filled, or refused.

use sspc_frames::read_picture;
use sspc_image::Image;
use sspc_testkit::exr_parts::{write_over, write_picture};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample").join(name)
}

/// `fit` of two halves with a few steps, and more arguments.
fn fit(a: &Path, b: &Path, out: &Path, arguments: &[String]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sspc-train"))
        .stdin(Stdio::null())
        .arg("fit")
        .args([a, b])
        .args(["--steps", "2", "-o"])
        .arg(out)
        .args(arguments)
        .output()
        .expect("sspc-train starts")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn report(out: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(out.join("report.json")).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

/// A picture of the sample's size with one channel not finite anywhere.
fn without_channel(path: &Path, channel: usize, value: f32) -> PathBuf {
    let mut picture = Image::from_fn(3, 192, 256, |c, y, x| 0.1 + 0.01 * ((c + 3 * y + 7 * x) % 50) as f32);
    picture.plane_mut(channel).fill(value);
    write_picture(path, &picture);
    path.to_path_buf()
}

#[test]
fn colour_without_a_finite_value_is_refused_by_the_name_of_its_channel() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (out, file) = (folder.path().join("out"), folder.path().join("bad.exr"));
    let noisy = read_picture(&sample("a.exr"), None).expect("the sample");
    let mut bad = noisy.clone();
    bad.plane_mut(1).fill(f32::NAN);
    let a = folder.path().join("a.exr");
    write_over(&a, &sample("a.exr"), &bad, &[]).expect("written");
    let output = fit(&a, &sample("b.exr"), &out, &[]);
    let message = said(&output);
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(message.contains("channel G of the noisy colour of half a"), "{message}");

    let cases = [
        ("--denoised-b", 2, f32::INFINITY, "channel B of the denoised colour of half b"),
        ("--denoised", 0, f32::NAN, "channel R of the denoised colour of the full buffer"),
    ];
    for (option, channel, value, expected) in cases {
        let bad = without_channel(&file, channel, value).display().to_string();
        let output = fit(&sample("a.exr"), &sample("b.exr"), &out, &[option.to_string(), bad]);
        let message = said(&output);
        assert_eq!(output.status.code(), Some(3), "{message}");
        assert!(message.contains(expected), "{message}");
    }
    assert!(!out.exists(), "a refused frame leaves a folder");
}

#[test]
fn a_feature_without_a_finite_pixel_is_left_out_and_said() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (out, file) = (folder.path().join("out"), folder.path().join("bad.exr"));
    let bad = without_channel(&file, 1, f32::NAN);
    let role = format!("--role=albedo-b={}", bad.display());
    let output = fit(&sample("a.exr"), &sample("b.exr"), &out, &[role]);
    let message = said(&output);
    assert!(output.status.success(), "{message}");
    assert!(message.contains("no pixel of the albedo is finite in both halves"), "{message}");
    let report = report(&out);
    assert_eq!(report["found"]["unusable"]["albedo"], true);
    assert_eq!(report["found"]["unusable"]["normal"], false);
    assert_eq!(report["found"]["missing_pixels"], 0);
    assert!(report["skipped"].to_string().contains("albedo"), "{}", report["skipped"]);
}

#[test]
fn missing_pixels_are_counted_and_filled() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = folder.path().join("out");
    let mut bad = read_picture(&sample("a.exr"), None).expect("the sample");
    for (c, y, x, value) in [(0, 5, 9, f32::NAN), (1, 5, 9, f32::INFINITY), (2, 100, 200, f32::NEG_INFINITY)] {
        bad.set(c, y, x, value);
    }
    let a = folder.path().join("a.exr");
    write_over(&a, &sample("a.exr"), &bad, &[]).expect("written");
    let output = fit(&a, &sample("b.exr"), &out, &[]);
    assert!(output.status.success(), "{}", said(&output));
    let report = report(&out);
    assert_eq!(report["found"]["missing_pixels"], 2);
    assert_eq!(report["steps_dropped"], 0);
    let corrected = read_picture(&out.join("corrected.exr"), None).expect("a picture");
    assert!(corrected.data().iter().all(|v| v.is_finite()));
}
