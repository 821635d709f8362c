//! Pictures of `run`, bit for bit as they were.

use sspc_testkit::frames::data;
use sspc_testkit::golden::{self, Case, Hashes};
use std::ffi::OsString;
use std::path::Path;

fn run(model: &str, kernels: &str, frame: &str, denoised: &[(&str, &str)], more: &[&str]) -> Vec<OsString> {
    let folder = data(frame);
    let mut all: Vec<OsString> = vec!["run".into(), folder.join("a.exr").into(), folder.join("b.exr").into()];
    denoised.iter().for_each(|(option, name)| all.extend([option.into(), folder.join(name).into()]));
    all.extend(["--model".into(), golden::folder().join(model).into()]);
    all.extend(["--kernels", kernels, "--quiet", "--output", "out.exr"].iter().chain(more).map(OsString::from));
    all
}

fn hashes(folder: &Path) -> Hashes {
    Hashes::from([("out.exr".into(), golden::hash_of_picture(&folder.join("out.exr")))])
}

#[test]
fn corrected_pictures_are_as_they_were() {
    let full = [("--denoised", "denoised.exr")];
    let files = [("--denoised-a", "denoised-a.exr"), ("--denoised-b", "denoised-b.exr"), full[0]];
    let none = ["--role", "albedo=none", "--role", "normal=none", "--role", "visibility=none"];
    let cases = [
        ("gated, fused", run("gated.onnx", "fused", "sample", &full, &[])),
        ("gated, tract", run("gated.onnx", "tract", "sample", &full, &[])),
        ("paper, fused", run("paper.onnx", "fused", "sample", &[], &[])),
        ("paper, tract", run("paper.onnx", "tract", "blender", &files, &[])),
        ("half the strength", run("gated.onnx", "fused", "blender", &files, &["--strength", "0.5"])),
        ("no features", run("gated.onnx", "fused", "blender", &files, &none)),
        ("small tiles", run("gated.onnx", "fused", "blender", &files, &["--tile", "24"])),
    ];
    let cases = cases.map(|(name, arguments)| Case { name, arguments, hashes, by_machine: name.contains("tract") });
    golden::check("run.json", env!("CARGO_BIN_EXE_sspc-infer"), &cases);
}
