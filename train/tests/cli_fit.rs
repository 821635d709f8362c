//! sspc-train as a user runs it, on the repository's sample.

use sspc_frames::read_picture;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

fn sample(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample").join(name)
}

fn command() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-train"));
    command.stdin(Stdio::null());
    command
}

/// `fit` of the sample with a few steps, and more arguments.
fn fit(out: &Path, arguments: &[&str]) -> Output {
    command()
        .arg("fit")
        .args([sample("a.exr"), sample("b.exr")])
        .args(["--steps", "4", "-o"])
        .arg(out)
        .args(arguments)
        .output()
        .expect("sspc-train starts")
}

fn report(out: &Path) -> serde_json::Value {
    let text = std::fs::read_to_string(out.join("report.json")).expect("a report");
    serde_json::from_str(&text).expect("JSON")
}

fn assert_success(output: &Output) {
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().expect("a temporary folder")
}

#[test]
fn a_fit_says_what_the_halves_weigh_and_who_says_so() {
    let folder = folder();
    let out = folder.path().join("fit");
    let output = fit(&out, &["--samples-a", "24", "--samples-b", "8"]);
    assert_success(&output);
    let said = String::from_utf8_lossy(&output.stderr).into_owned() + &String::from_utf8_lossy(&output.stdout);
    let line = "samples of half a + half b: 24 + 8 (--samples-a, --samples-b); weights 0.750 + 0.250";
    assert!(said.contains(line), "{said}");
    let samples = &report(&out)["samples"];
    assert_eq!(samples["source"], "arguments");
    assert_eq!(samples["counts"], serde_json::json!([24.0, 8.0]));
    assert_eq!(samples["weights"], serde_json::json!([0.75, 0.25]));

    let equal = folder.path().join("equal");
    assert_success(&fit(&equal, &[]));
    let samples = &report(&equal)["samples"];
    assert_eq!((&samples["source"], &samples["counts"]), (&serde_json::json!("none"), &serde_json::Value::Null));
    assert_eq!(samples["weights"], serde_json::json!([0.5, 0.5]));
    let as_many = folder.path().join("as-many");
    assert_success(&fit(&as_many, &["--samples-a", "8", "--samples-b", "8"]));
    let picture = |folder: &Path| read_picture(&folder.join("corrected.exr"), None).expect("a picture");
    assert_eq!(picture(&as_many).data(), picture(&equal).data());
    assert_ne!(picture(&out).data(), picture(&equal).data());
}

#[test]
fn samples_that_no_halves_can_have_are_refused() {
    let folder = folder();
    let out = folder.path().join("fit");
    for (arguments, said) in [
        (&["--samples-a", "0", "--samples-b", "8"][..], "--samples-a"),
        (&["--samples-a", "8"], "--samples-b"),
        (&["--samples-b", "8"], "--samples-a"),
        (&["--samples-a", "many", "--samples-b", "8"], "--samples-a"),
        (&["--samples-a", "99999999", "--samples-b", "99999999"], "--samples-a"),
        (&["--samples-a", "4096", "--samples-b", "8"], "at most 256 times as many"),
    ] {
        let output = fit(&out, arguments);
        let message = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() == Some(2) && message.contains(said), "{arguments:?}: {message}");
    }
    assert!(!out.exists());
}

#[test]
fn a_fit_writes_picture_model_report_and_previews() {
    let folder = folder();
    let out = folder.path().join("fit");
    let (denoised, reference) = (sample("denoised.exr"), sample("ref.exr"));
    let more = ["--denoised", denoised.to_str().expect("UTF-8"), "--reference", reference.to_str().expect("UTF-8")];
    assert_success(&fit(&out, &more));
    for name in ["noisy", "denoised", "corrected", "reference", "error-denoised", "error-corrected", "comparison"] {
        let png = std::fs::read(out.join(name).with_extension("png")).expect(name);
        assert_eq!(&png[1..4], b"PNG", "{name}");
    }
    let report = report(&out);
    for key in ["steps", "seed", "preset", "backend", "roles", "skipped", "version", "peak_rss_bytes"] {
        assert!(!report[key].is_null(), "{key} is missing");
    }
    for key in ["read", "train", "correct", "write", "total"] {
        assert!(report["seconds"][key].as_f64().is_some_and(|s| s > 0.0), "seconds.{key}");
    }
    let value = |group: &str, key: &str| report[group][key].as_f64().expect("a number");
    assert_eq!(report["steps"], 4);
    assert!(value("rel_l2", "denoised") < value("rel_l2", "noisy"));
    // The analytic start alone is better than this frame's denoiser.
    assert!(value("rel_l2", "corrected") < value("rel_l2", "denoised"));
    assert!(value("loss", "corrected") < value("loss", "denoised"));
    assert!(report["estimate"]["corrected"]["standard_error"].as_f64().is_some_and(|e| e > 0.0));
    let estimate = |what: &str| report["estimate"][what]["value"].as_f64().expect("a number");
    let difference = estimate("denoised") - estimate("corrected");
    assert!((estimate("gain") - difference).abs() <= 1e-9 * difference.abs(), "gain is the difference");
    // The mean of halves starts from noisier z than the full buffer's.
    let halves = |what: &str| report["rel_l2"]["halves"][what].as_f64().expect("a number");
    assert!(halves("corrected") < halves("denoised") && halves("denoised") > value("rel_l2", "denoised"));
    let corrected = read_picture(&out.join("corrected.exr"), None).expect("a picture");
    assert_eq!((corrected.width(), corrected.height()), (256, 192));
    assert!(corrected.data().iter().all(|v| v.is_finite() && *v >= 0.0));
}

#[test]
fn the_same_seed_gives_the_same_bytes_for_any_number_of_threads() {
    let folder = folder();
    let pictures = ["1", "2", "4"].map(|threads| {
        let out = folder.path().join(threads);
        let output = command()
            .env("RAYON_NUM_THREADS", threads)
            .arg("fit")
            .args([sample("a.exr"), sample("b.exr")])
            .args(["--steps", "3", "--quiet", "-o"])
            .arg(&out)
            .output()
            .expect("sspc-train starts");
        assert_success(&output);
        assert!(output.stderr.is_empty(), "--quiet prints {}", String::from_utf8_lossy(&output.stderr));
        ["corrected.exr", "model.onnx", "comparison.png"].map(|name| std::fs::read(out.join(name)).expect(name))
    });
    assert!(pictures[0] == pictures[1] && pictures[0] == pictures[2], "other bytes");
}

#[test]
fn progress_is_told_to_a_farm() {
    let folder = folder();
    let output = fit(&folder.path().join("fit"), &["--quiet", "--progress", "openjd"]);
    assert_success(&output);
    assert!(output.stderr.is_empty(), "{}", String::from_utf8_lossy(&output.stderr));
    let said = String::from_utf8_lossy(&output.stdout);
    let percentages: Vec<f64> = said
        .lines()
        .filter_map(|line| line.strip_prefix("openjd_progress: "))
        .map(|text| text.parse().expect("a number"))
        .collect();
    assert!(percentages.is_sorted() && percentages.last() == Some(&100.0), "{said}");
    assert!(said.contains("openjd_status: training step 4/4, loss "), "{said}");
    assert!(said.lines().all(|line| line.starts_with("openjd_")), "{said}");

    let missing = folder.path().join("no\nsuch.exr");
    let arguments = ["--role", &format!("albedo={}", missing.display()), "--progress", "openjd"];
    let output = fit(&folder.path().join("other"), &arguments);
    assert_eq!(output.status.code(), Some(3));
    let said = String::from_utf8_lossy(&output.stdout);
    let last = said.lines().last().unwrap_or_default();
    assert!(last.starts_with("openjd_fail: ") && last.contains("such.exr"), "{said}");
}

#[test]
fn strength_0_gives_the_denoisers_picture() {
    let folder = folder();
    let picture = |strength: &str| {
        let out = folder.path().join(strength);
        let denoised = sample("denoised.exr");
        let more = ["--denoised", denoised.to_str().expect("UTF-8"), "--strength", strength];
        assert_success(&fit(&out, &more));
        assert_eq!(report(&out)["strength"].as_f64(), strength.parse().ok());
        read_picture(&out.join("corrected.exr"), None).expect("a picture")
    };
    let denoised = read_picture(&sample("denoised.exr"), None).expect("a picture");
    assert!(picture("0") == denoised, "another picture than the denoiser's");
    assert!(picture("0.5") != denoised, "the denoiser's picture");
    let output = fit(&folder.path().join("more"), &["--strength", "1.1"]);
    assert_eq!(output.status.code(), Some(2), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn bad_input_is_one_line_and_leaves_nothing() {
    let folder = folder();
    let text = folder.path().join("text.exr");
    std::fs::write(&text, "not a picture").expect("written");
    let truncated = folder.path().join("truncated.exr");
    let whole = std::fs::read(sample("a.exr")).expect("the sample");
    std::fs::write(&truncated, &whole[..whole.len() / 3]).expect("written");
    let a = sample("a.exr");
    let cases: [(&str, PathBuf, PathBuf, &str); 5] = [
        ("a missing file", "missing.exr".into(), sample("b.exr"), "missing.exr"),
        ("text", text, sample("b.exr"), "not an OpenEXR file"),
        ("a truncated file", truncated, sample("b.exr"), "truncated"),
        ("identical halves", a.clone(), a.clone(), "same value in every pixel"),
        ("no denoised role", sample("denoised.exr"), sample("ref.exr"), "denoised colour of half a"),
    ];
    for (what, a, b, expected) in cases {
        let out = folder.path().join("out");
        // A machine with Open Image Denoise would make what is missing.
        let mut command = command();
        command.env("OIDN_DIR", folder.path()).arg("fit").args([a, b]).arg("-o").arg(&out);
        let output = command.output().expect("sspc-train starts");
        let message = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(3), "{what}: {message}");
        let errors: Vec<&str> = message.lines().filter(|line| line.contains("error:")).collect();
        assert!(errors.len() == 1 && errors[0].contains(expected), "{what}: {message}");
        assert!(!out.exists(), "{what} leaves a folder");
    }
}

#[test]
fn a_file_of_another_size_is_named_with_both_sizes() {
    let folder = folder();
    let out = folder.path().join("out");
    let small = sample("../blender/denoised.exr");
    let output = fit(&out, &["--denoised", small.to_str().expect("UTF-8")]);
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{message}");
    assert!(message.contains("256x192") && message.contains("96x64"), "{message}");
    assert!(!out.exists());
}

#[test]
fn an_output_that_cannot_be_written_is_said_before_training() {
    let folder = folder();
    let file = folder.path().join("file");
    std::fs::write(&file, "in the way").expect("written");
    for out in [file.join("below"), file.clone(), folder.path().join("no/such/parent")] {
        let output = fit(&out, &[]);
        assert_eq!(output.status.code(), Some(4), "{}", out.display());
        assert!(!String::from_utf8_lossy(&output.stderr).contains("training"), "{} is found late", out.display());
    }
    assert_eq!(std::fs::read_to_string(&file).expect("the file"), "in the way");
}

#[test]
fn arguments_without_meaning_end_with_2() {
    let folder = folder();
    let out = folder.path().join("out");
    for bad in [["--preset", "best"], ["--time-limit", "-1"], ["--role", "radiance"], ["--frames", "1-2"]] {
        assert_eq!(fit(&out, &bad).status.code(), Some(2), "{bad:?}");
    }
    assert!(!out.exists());
}

#[test]
fn every_feature_is_optional_and_its_absence_is_said() {
    let folder = folder();
    for (i, absent) in
        [&["albedo"][..], &["normal"], &["visibility"], &["albedo", "normal", "visibility"]].iter().enumerate()
    {
        let out = folder.path().join(i.to_string());
        let roles: Vec<String> = absent.iter().map(|role| format!("--role={role}=none")).collect();
        let roles: Vec<&str> = roles.iter().map(String::as_str).collect();
        assert_success(&fit(&out, &roles));
        let skipped = report(&out)["skipped"].to_string();
        assert!(absent.iter().all(|role| skipped.contains(role)), "{absent:?}: {skipped}");
    }
}

#[test]
fn a_dry_run_names_roles_and_writes_nothing() {
    let folder = folder();
    let out = folder.path().join("out");
    let output = fit(&out, &["--dry-run"]);
    assert_success(&output);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("albedo of half b") && said.contains("[normal.X,normal.Y,normal.Z]"), "{said}");
    assert!(!out.exists());
}

#[test]
fn a_time_limit_ends_training_with_a_picture() {
    let folder = folder();
    let out = folder.path().join("out");
    let output = command()
        .arg("fit")
        .args([sample("a.exr"), sample("b.exr")])
        .args(["--steps", "100000", "--time-limit", "0.3", "-o"])
        .arg(&out)
        .output()
        .expect("sspc-train starts");
    assert_success(&output);
    let report = report(&out);
    assert_eq!(report["end"], "time-limit");
    assert!(report["steps"].as_u64().is_some_and(|steps| (1..100_000).contains(&steps)));
}

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

#[cfg(unix)]
#[test]
fn ctrl_c_ends_with_130_and_leaves_nothing() {
    let folder = folder();
    let out = folder.path().join("out");
    let mut child = command()
        .arg("fit")
        .args([sample("a.exr"), sample("b.exr")])
        .args(["--steps", "1000000", "-o"])
        .arg(&out)
        .stderr(Stdio::null())
        .spawn()
        .expect("sspc-train starts");
    std::thread::sleep(Duration::from_millis(1500));
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    assert_eq!(child.wait().expect("it ends").code(), Some(130));
    assert!(!out.exists(), "an interrupted fit leaves {}", out.display());
}

/// Fails when a setting is missing from the report, or told as a text that only Rust reads.
#[test]
fn the_report_holds_every_setting_as_data() {
    let folder = folder();
    let out = folder.path().join("fit");
    assert_success(&fit(&out, &["--preset", "quality", "--set", "influence=inf"]));
    let report = report(&out);
    let settings = report["settings"].as_object().expect("settings");
    for key in [
        "preset",
        "form",
        "network",
        "window_radius",
        "exposure",
        "start",
        "combination",
        "sampling",
        "diagonal",
        "tile",
        "batch",
        "rate",
        "steps",
        "steps_grow_from",
        "epochs",
        "denominator",
        "influence",
        "composition",
        "features",
        "skip",
        "held_out",
        "changed",
        "seed",
    ] {
        assert!(settings.contains_key(key), "no {key} in {settings:?}");
    }
    assert_eq!(settings["rate"]["cosine"]["peak"], 0.004);
    assert_eq!(settings["start"]["analytic"]["gate"], 0.7);
    assert_eq!(settings["steps_grow_from"], 640 * 360);
    assert!(settings["influence"].is_null());
    assert_eq!(report["planned_steps"], 4);
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

#[test]
fn a_page_is_written_when_it_is_asked_for_and_changes_no_picture() {
    let folder = folder();
    let (plain, paged) = (folder.path().join("plain"), folder.path().join("paged"));
    assert_success(&fit(&plain, &[]));
    assert_success(&fit(&paged, &["--report"]));
    assert!(!plain.join("report.html").exists());
    let html = std::fs::read_to_string(paged.join("report.html")).expect("a page");
    assert!(html.len() < 5_000_000 && html.contains("\"label\":\"share\""));
    let picture = |out: &Path| std::fs::read(out.join("corrected.exr")).expect("a picture");
    assert!(picture(&plain) == picture(&paged));
    // A page that cannot be written is told of before training.
    let blocked = folder.path().join("blocked");
    std::fs::create_dir_all(blocked.join("report.html")).expect("a folder in the way");
    let refused = fit(&blocked, &["--report"]);
    assert!(!refused.status.success());
    assert!(String::from_utf8_lossy(&refused.stderr).contains("report.html"));
    assert!(!blocked.join("model.onnx").exists());
}
