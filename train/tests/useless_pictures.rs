//! A further denoised picture that says nothing of the frame costs nothing: the fit is that without it.

use sspc_image::Image;
use sspc_testkit::exr_parts::write_picture;
use sspc_testkit::frames::data;
use sspc_testkit::lit_frame::read_layer;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The sample's denoised half after a change, as a file.
fn changed(
    folder: &Path,
    half: &str,
    name: &str,
    change: impl Fn(&Image, usize, usize, usize) -> f32 + Sync,
) -> PathBuf {
    let z = read_layer(&data("sample").join(format!("{half}.exr")), "denoised", "RGB");
    let path = folder.join(format!("{name}-{half}.exr"));
    write_picture(&path, &Image::from_fn(3, z.height(), z.width(), |c, y, x| change(&z, c, y, x)));
    path
}

/// Fits the sample with further pictures; its model and its report.
fn fit(out: &Path, further: &[[PathBuf; 2]]) -> (Vec<u8>, serde_json::Value) {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-train"));
    command.arg("fit").args(["a.exr", "b.exr"].map(|name| data("sample").join(name)));
    command.args(["--steps", "6", "--quiet", "-o"]).arg(out);
    for [a, b] in further {
        command.arg("--denoised-more").arg(format!("{},{}", a.display(), b.display()));
    }
    let output = command.output().expect("sspc-train starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let report = std::fs::read(out.join("report.json")).expect("a report");
    (std::fs::read(out.join("corrected.exr")).expect("a picture"), serde_json::from_slice(&report).expect("JSON"))
}

#[test]
fn a_picture_that_says_nothing_is_left_out_and_another_stays() {
    let folder = tempfile::tempdir().expect("a temporary folder");
    let out = |name: &str| folder.path().join(name);
    let upside_down =
        ["a", "b"].map(|half| changed(folder.path(), half, "upside-down", |z, c, y, x| z.at(c, z.height() - 1 - y, x)));
    // Sharper by what a blur takes away: it errs otherwise, and knows nothing of the other half.
    let other = ["a", "b"].map(|half| {
        changed(folder.path(), half, "sharper", |z, c, y, x| {
            let beside = |dx: usize| z.at(c, y, (x + dx).saturating_sub(1).min(z.width() - 1));
            z.at(c, y, x) + 0.5 * (z.at(c, y, x) - 0.5 * (beside(0) + beside(2)))
        })
    });
    let (alone, _) = fit(&out("alone"), &[]);
    let (picture, report) = fit(&out("upside-down"), std::slice::from_ref(&upside_down));
    assert!(picture == alone, "a picture of no use changed the result");
    assert_eq!(report["network_weights"], serde_json::json!([1.0]));
    let told = report["warnings"].to_string();
    assert!(told.contains("further denoised picture 1 leads nowhere from the first one"), "{told}");

    let (picture, report) = fit(&out("both"), &[upside_down, other.clone()]);
    let (with_other, _) = fit(&out("other"), &[other]);
    assert_eq!(report["network_weights"].as_array().map(Vec::len), Some(2));
    assert!(picture == with_other && picture != alone);
}
