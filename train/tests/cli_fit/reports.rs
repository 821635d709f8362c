//! What a fit tells: its log, its report, its page, a farm.

use crate::{assert_success, fit, folder, report};
use sspc_frames::read_picture;
use std::path::Path;

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
fn no_more_threads_run_than_there_are_cores() {
    let folder = folder();
    let out = folder.path().join("fit");
    assert_success(&fit(&out, &["--threads", "4096"]));
    let cores = std::thread::available_parallelism().expect("cores").get();
    assert_eq!(report(&out)["threads"], serde_json::json!(cores.min(4096)));
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
        "early_window_radius",
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
