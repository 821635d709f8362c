//! Pictures and weights of a fit, bit for bit as they were.

use sspc_testkit::frames::data;
use sspc_testkit::golden::{self, Case, Hashes};
use std::ffi::OsString;
use std::path::Path;

/// The frame with every role, at a size where every part of a fit has something to do.
fn sample(arguments: &[&str]) -> Vec<OsString> {
    fit(data("sample").as_path(), &[("--denoised", "denoised.exr")], arguments)
}

/// The sample frame without a denoised full buffer.
fn halves(arguments: &[&str]) -> Vec<OsString> {
    fit(data("sample").as_path(), &[], arguments)
}

/// A small frame of many parts, without visibility.
fn blender(arguments: &[&str]) -> Vec<OsString> {
    let denoised =
        [("--denoised-a", "denoised-a.exr"), ("--denoised-b", "denoised-b.exr"), ("--denoised", "denoised.exr")];
    fit(data("blender").as_path(), &denoised, arguments)
}

fn fit(folder: &Path, denoised: &[(&str, &str)], arguments: &[&str]) -> Vec<OsString> {
    let mut all: Vec<OsString> = vec!["fit".into(), folder.join("a.exr").into(), folder.join("b.exr").into()];
    denoised.iter().for_each(|(option, name)| all.extend([option.into(), folder.join(name).into()]));
    all.extend(["--quiet", "--output", "out"].iter().chain(arguments).map(OsString::from));
    all
}

fn hashes(folder: &Path) -> Hashes {
    let out = folder.join("out");
    let picture = golden::hash_of_picture(&out.join("corrected.exr"));
    let weights = golden::hash_of_weights(&out.join("model.onnx"));
    Hashes::from([("corrected.exr".into(), picture), ("model.onnx".into(), weights)])
}

#[test]
fn fits_are_as_they_were() {
    let no_features = ["--role", "albedo=none", "--role", "normal=none", "--role", "visibility=none"];
    let none = |more: &[&'static str]| [&no_features, more].concat();
    let cases = [
        ("fast", sample(&["--preset", "fast", "--steps", "12"])),
        ("fast, three layers", sample(&["--preset", "fast", "--steps", "12", "--set", "layers=3"])),
        ("balanced", sample(&["--steps", "12"])),
        ("quality", halves(&["--preset", "quality", "--steps", "6"])),
        ("paper", halves(&["--preset", "paper", "--steps", "1"])),
        ("another seed", blender(&["--seed", "7", "--steps", "20"])),
        ("half the strength", blender(&["--strength", "0.5", "--steps", "10"])),
        ("no features", blender(&none(&["--steps", "10"]))),
        ("paper without features", blender(&none(&["--preset", "paper", "--steps", "2", "--set", "batch=2"]))),
        ("f_c", blender(&["--set", "combination=fc", "--steps", "10"])),
        ("other settings", blender(&["--set", "window=7", "--set", "hidden=4", "--set", "gate=none", "--steps", "10"])),
        ("nothing skipped", blender(&["--set", "skip=none", "--set", "sampling=uniform", "--steps", "10"])),
    ];
    let cases = cases.map(|(name, arguments)| Case { name, arguments, hashes, by_machine: false });
    golden::check("fit.json", env!("CARGO_BIN_EXE_sspc-train"), &cases);
}
