//! `fit` of frames without denoised pictures, as a user runs it: with the library of PyPI's pyoidn in the environment that
//! `SSPC_PYTHON_VENV` names, and without any.

use sspc_frames::read_picture;
use sspc_testkit::c_programs::oidn_stand_in;
use sspc_testkit::lit_frame::{LitFrame, read_layer};
use sspc_testkit::skips::skipped;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample").join(name)
}

/// `fit` of the sample without its denoised layers, in an environment where nothing leads to a library.
fn fit(out: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-train"));
    for variable in ["OIDN_DIR", "VIRTUAL_ENV", "CONDA_PREFIX", "PATH", "HOME"] {
        command.env_remove(variable);
    }
    command.stdin(Stdio::null()).arg("fit").args([sample("a.exr"), sample("b.exr")]);
    command.args(["--role", "denoised=none", "--steps", "4", "-o"]).arg(out).args(arguments);
    command
}

fn run(mut command: Command) -> (Option<i32>, String) {
    let Output { status, stderr, .. } = command.output().expect("sspc-train starts");
    (status.code(), String::from_utf8_lossy(&stderr).into_owned())
}

/// The environment of the tests, where it has the library.
fn environment() -> Option<PathBuf> {
    let python = std::env::var_os("SSPC_PYTHON_VENV").map(PathBuf::from);
    let environment = python.as_ref().and_then(|python| python.parent()?.parent()).map(Path::to_path_buf);
    let has_library = |folder: &PathBuf| {
        let folders = sspc_oidn::search::folders_of_python(folder);
        folders.iter().any(|folder| !sspc_oidn::search::libraries_in(folder).is_empty())
    };
    let found = environment.filter(has_library);
    if found.is_none() {
        skipped("Open Image Denoise", "SSPC_PYTHON_VENV names no environment with pyoidn; .ci/setup-python makes one");
    }
    found
}

fn report(out: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(out.join("report.json")).expect("a report")).expect("JSON")
}

fn assert_fails(outcome: &(Option<i32>, String), out: &Path, words: &[&str]) {
    assert_fails_with(3, outcome, out, words);
}

fn assert_fails_with(code: i32, outcome: &(Option<i32>, String), out: &Path, words: &[&str]) {
    let (found, message) = outcome;
    assert_eq!(*found, Some(code), "{message}");
    let errors: Vec<&str> = message.lines().filter(|line| line.starts_with("error:")).collect();
    assert!(errors.len() == 1 && words.iter().all(|word| message.contains(word)), "{message}");
    assert!(message.contains("advice:") && !out.exists(), "{message}");
}

#[test]
fn without_a_library_the_frame_is_refused_and_says_how_to_get_one() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let outcome = run(fit(&out, &[]));
    if outcome.0 == Some(0) {
        skipped("no library", "this machine has one where it is always found");
    } else {
        let words = ["no denoised colour of half a", "Open Image Denoise", "pip install pyoidn", "brew", "--oidn"];
        assert_fails(&outcome, &out, &words);
    }
}

#[test]
fn a_library_that_is_named_and_is_none_is_an_error_that_says_so() {
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let named = folder.path().join("libOpenImageDenoise.so.2");
    let name = named.to_str().expect("UTF-8");
    assert_fails(&run(fit(&out, &["--oidn", name])), &out, &["--oidn", "found none"]);
    let mut command = fit(&out, &[]);
    command.env("OIDN_DIR", folder.path());
    assert_fails(&run(command), &out, &["OIDN_DIR", "found none"]);
    std::fs::write(&named, "text").expect("written");
    assert_fails(&run(fit(&out, &["--oidn", name])), &out, &["libOpenImageDenoise.so.2", "cannot be opened"]);
    let (code, message) = run(fit(&out, &["--oidn-modes", "aux,albedo"]));
    assert!(code == Some(2) && message.contains("expected aux, clean-aux, colour"), "{message}");
}

#[test]
fn a_library_that_fails_leaves_nothing_behind() {
    let cases = [
        ("OLD_VERSION", 3, "expected Open Image Denoise 2.0 or later, found 1.99.1"),
        ("BAD_DEVICE", 3, "cannot start: no thread could be started"),
        ("HALF_WAY", 4, "Open Image Denoise 2.3.0 failed on 256x192 pixels (aux, balanced): out of memory"),
        ("NOT_FINITE", 4, "returned 2 values of 256x192 pixels that are not finite"),
    ];
    for (fault, code, words) in cases {
        let folder = tempfile::tempdir().expect("a folder");
        let out = folder.path().join("out");
        let Some(library) = oidn_stand_in(folder.path(), fault) else { return };
        let outcome = run(fit(&out, &["--oidn", library.to_str().expect("UTF-8")]));
        assert_fails_with(code, &outcome, &out, &[words]);
    }
}

#[test]
fn two_files_are_enough() {
    let Some(environment) = environment() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let pictures = ["1", "2"].map(|threads| {
        let out = folder.path().join(threads);
        let mut command = fit(&out, &[]);
        command.env("VIRTUAL_ENV", &environment).env("RAYON_NUM_THREADS", threads);
        let (code, message) = run(command);
        assert_eq!(code, Some(0), "{message}");
        assert!(message.contains("half a, half b and the full buffer: made (aux,clean-aux; balanced)"), "{message}");
        ["corrected.exr", "model.onnx"].map(|name| std::fs::read(out.join(name)).expect(name))
    });
    assert!(pictures[0] == pictures[1], "other bytes with other threads");
    let report = report(&folder.path().join("2"));
    let denoiser = &report["denoiser"];
    assert!(denoiser["version"].as_str().is_some_and(|version| version.starts_with("2.")), "{denoiser}");
    assert_eq!(denoiser["modes"], serde_json::json!(["aux", "clean-aux"]));
    let buffers: Vec<_> = denoiser["pictures"].as_array().expect("pictures").iter().map(|p| &p["buffer"]).collect();
    assert_eq!(buffers, ["a", "a", "b", "b", "full", "full"]);
    assert!(report["loss"]["corrected"].as_f64() < report["loss"]["denoised"].as_f64());
}

#[test]
fn a_dry_run_makes_nothing_and_strength_0_trains_nothing() {
    let Some(environment) = environment() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let with_library = |arguments: &[&str]| {
        let mut command = fit(&out, arguments);
        command.env("VIRTUAL_ENV", &environment);
        run(command)
    };
    let expected =
        [("fast", "aux; high"), ("balanced", "aux,clean-aux; balanced"), ("quality", "aux,clean-aux,colour; high")];
    for (preset, made) in expected {
        let (code, message) = with_library(&["--dry-run", "--preset", preset]);
        assert!(code == Some(0) && message.contains(&format!("would be made ({made})")) && !out.exists(), "{message}");
    }
    let (code, message) = with_library(&["--strength", "0", "--oidn-quality", "fast"]);
    assert!(code == Some(0) && message.contains("made (aux; fast)"), "{message}");
    assert_eq!(report(&out)["steps"], 0);
    let picture = |name: &Path| read_picture(name, None).expect("a picture");
    let (denoised, noisy) = (picture(&out.join("corrected.exr")), picture(&sample("a.exr")));
    assert!(denoised.same_size(&noisy) && denoised != noisy);
    assert!(denoised.data().iter().all(|value| value.is_finite() && *value >= 0.0));
}

#[test]
fn modes_beside_denoised_files_are_further_pictures() {
    let Some(environment) = environment() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let out = folder.path().join("out");
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-train"));
    command.env("VIRTUAL_ENV", &environment).arg("fit").args([sample("a.exr"), sample("b.exr")]);
    command.args(["--steps", "2", "--oidn-modes", "clean-aux,colour,clean-aux", "-o"]).arg(&out);
    let (code, message) = run(command);
    assert_eq!(code, Some(0), "{message}");
    assert!(message.contains("denoised colour of half a from"), "{message}");
    assert_eq!(report(&out)["denoiser"]["modes"], serde_json::json!(["clean-aux", "colour"]));
}

/// Denoised passes are put together, and take part in the picture as far as the halves say.
#[test]
fn denoised_passes_take_part_in_the_picture_and_add_up_to_it() {
    let Some(environment) = environment() else { return };
    let folder = tempfile::tempdir().expect("a folder");
    let mut frame = LitFrame::new(48, 80, &["Diffuse Direct", "Glossy Direct", "Emission"]);
    frame.picture = "Combined".into();
    frame.lights[0].colour = Some("Diffuse Color".into());
    frame.lights[1].colour = Some("Glossy Color".into());
    frame.write(folder.path());
    let fit = |out: &str, arguments: &[&str]| {
        let out = folder.path().join(out);
        let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-train"));
        command
            .env("VIRTUAL_ENV", &environment)
            .arg("fit")
            .args(["a.exr", "b.exr"].map(|name| folder.path().join(name)));
        command.args(["--role", "denoised=none", "--steps", "4", "-o"]).arg(&out).args(arguments);
        let (code, message) = run(command);
        assert_eq!(code, Some(0), "{message}");
        (report(&out), out.join("corrected.exr"))
    };
    let (with, picture) = fit("with", &["--passes", "auto"]);
    let share = with["composite_share"].as_f64().expect("a share");
    assert!(share > 0.0 && share <= 1.0, "{share}");
    let error = frame.sum_error(&picture);
    assert!(error <= 1.2e-7, "{error}");
    // Averaged by the picture's own weights, passes tell the picture nothing.
    let (by_filter, filtered) = fit("filter", &["--passes", "auto", "--passes-by", "filter"]);
    let (without, alone) = fit("without", &[]);
    assert!(by_filter.get("composite_share").is_none() && without.get("composite_share").is_none());
    let [picture, filtered, alone] = [picture, filtered, alone].map(|path| read_layer(&path, "Combined", "RGB"));
    assert!(filtered == alone && picture != alone);
}
