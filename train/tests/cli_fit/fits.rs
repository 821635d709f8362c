//! What a fit writes and when it ends.

use crate::{assert_success, command, fit, folder, report, sample};
use sspc_frames::read_picture;
use std::process::{Command, Stdio};
use std::time::Duration;

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
