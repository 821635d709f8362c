//! `sspc-infer run` and `info` as a person or a farm runs them.

mod models;

use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_frames::{read_picture, read_reference};
use sspc_image::Image;
use sspc_kernels::parameters::Form;
use sspc_metrics::rel_l2;
use sspc_onnx::{Contract, Model, write_image, write_network};
use sspc_testkit::closeness::assert_images_close;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

fn sample(name: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample").join(name)
}

/// The analytic start: of use without any training.
fn start_model() -> Model {
    let mut contract = Contract::new(Form::Gated);
    contract.frames = vec!["kitchen.1001.exr".into()];
    contract.preset = "none".into();
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    Model::new(contract, weights).expect("a model")
}

/// A folder with `model.onnx` and three frames of a shot, all of them the sample.
fn shot() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("folder");
    std::fs::write(folder.path().join("model.onnx"), write_network(&start_model())).expect("model");
    for frame in 1..=3 {
        for half in ["a", "b"] {
            let to = folder.path().join(format!("{half}.{frame:04}.exr"));
            std::fs::copy(sample(&format!("{half}.exr")), to).expect("frame");
        }
    }
    std::fs::create_dir(folder.path().join("out")).expect("out");
    folder
}

fn command(folder: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
    command.current_dir(folder).arg("run").args(["--model", "model.onnx"]).args(arguments);
    command
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    command(folder, arguments).output().expect("sspc-infer runs")
}

fn shot_arguments<'a>(frames: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let mut all = vec!["--a", "a.####.exr", "--b", "b.####.exr", "--frames", frames, "-o", "out/c.####.exr"];
    all.extend(more);
    all
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn files_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).expect("folder");
    let mut names: Vec<String> =
        entries.map(|e| e.expect("entry").file_name().to_string_lossy().into_owned()).collect();
    names.sort();
    names
}

fn picture(path: &Path) -> Image {
    read_picture(path, None).expect("a picture")
}

#[test]
fn one_frame_is_corrected_and_described() {
    let folder = shot();
    let arguments = ["a.0001.exr", "b.0001.exr", "-o", "out/c.exr", "--json", "--verbose"];
    let output = run(folder.path(), &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let out = folder.path().join("out");
    assert_eq!(files_in(&out), ["c.exr", "c.json"]);
    let corrected = picture(&out.join("c.exr"));
    let noisy = picture(&sample("a.exr"));
    assert!(corrected.same_size(&noisy) && corrected != noisy);
    let json = std::fs::read(out.join("c.json")).expect("sidecar");
    let json: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
    assert_eq!(json["width"], 256);
    assert_eq!(json["model"]["frames"][0], "kitchen.1001.exr");
    for time in ["read", "features", "correct", "write", "total"] {
        assert!(json["seconds"][time].as_f64().expect(time) > 0.0, "{time}");
    }
    let first_tile = json["first_tile_after"].as_f64().expect("a time");
    assert!(0.0 < first_tile && first_tile < json["seconds"]["total"].as_f64().expect("a time"), "{first_tile}");
    assert!(json["loss"]["corrected"].as_f64() < json["loss"]["denoised"].as_f64());
}

#[test]
fn kernels_threads_and_tiles_do_not_show() {
    let folder = shot();
    let variants: [&[&str]; 4] = [&[], &["--tile", "37"], &["--threads", "1"], &["--kernels", "tract", "--tile", "64"]];
    let pictures: Vec<Image> = variants
        .iter()
        .map(|more| {
            let arguments = [&["a.0001.exr", "b.0001.exr", "-o", "out/c.exr"], *more].concat();
            let output = run(folder.path(), &arguments);
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
            picture(&folder.path().join("out/c.exr"))
        })
        .collect();
    assert!(pictures[0] == pictures[1] && pictures[0] == pictures[2]);
    // Stored as half floats: one unit in the last place is 1e-3 of the value.
    assert_images_close(&pictures[3], &pictures[0], 1.5e-3, "tract's own operators");
}

#[test]
fn a_bad_frame_does_not_stop_the_others() {
    let folder = shot();
    std::fs::write(folder.path().join("a.0002.exr"), b"v/1\x01 cut off").expect("bad frame");
    let output = run(folder.path(), &shot_arguments("1-4", &[]));
    assert_eq!(output.status.code(), Some(3), "{}", stderr(&output));
    let said = stderr(&output);
    assert!(said.contains("frame 2: a.0002.exr") && said.contains("frame 4: a.0004.exr"), "{said}");
    assert!(said.contains("2 of 4 frames failed"), "{said}");
    assert_eq!(files_in(&folder.path().join("out")), ["c.0001.exr", "c.0003.exr"]);
}

#[test]
fn chunks_of_a_shot_give_its_pixels_however_it_is_cut() {
    let folder = shot();
    // Frames unlike their neighbours: the halves change places.
    for frame in ["0002", "0004"] {
        for (half, from) in [("a", "b"), ("b", "a")] {
            let to = folder.path().join(format!("{half}.{frame}.exr"));
            std::fs::copy(sample(&format!("{from}.exr")), to).expect("frame");
        }
    }
    let pictures = |chunks: &[&str], threads: &str| {
        for chunk in chunks {
            let output = run(folder.path(), &shot_arguments(chunk, &["--threads", threads]));
            assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        }
        let out = folder.path().join("out");
        let files: Vec<Vec<u8>> =
            files_in(&out).iter().map(|name| std::fs::read(out.join(name)).expect("picture")).collect();
        files_in(&out).iter().for_each(|name| std::fs::remove_file(out.join(name)).expect("removed"));
        files
    };
    let whole = pictures(&["1-4"], "2");
    assert!(whole.len() == 4 && whole[0] != whole[1], "four frames, not all alike");
    for cut in [&["1", "2", "3", "4"][..], &["3-4", "1-2"], &["1-4x2", "2,4"], &["1-3", "4"]] {
        assert!(pictures(cut, "1") == whole, "{cut:?}: other bytes than the whole shot");
    }
}

#[test]
fn progress_is_told_to_a_farm() {
    let folder = shot();
    let told = |frames: &str, more: &[&str]| {
        let output = run(folder.path(), &shot_arguments(frames, &[&["--progress", "openjd"], more].concat()));
        (output.status.code(), String::from_utf8_lossy(&output.stdout).into_owned(), stderr(&output))
    };
    let (code, said, _) = told("1-2", &["--quiet"]);
    assert_eq!(code, Some(0));
    let expected = "openjd_progress: 0.0\nopenjd_status: frame 1\nopenjd_progress: 50.0\nopenjd_status: frame 2\n\
                    openjd_progress: 100.0\n";
    assert_eq!(said, expected);

    std::fs::write(folder.path().join("a.0002.exr"), b"v/1\x01 cut off").expect("bad frame");
    let (code, said, errors) = told("1-3", &[]);
    assert_eq!(code, Some(3));
    assert!(said.contains("openjd_status: frame 2: a.0002.exr"), "{said}");
    assert!(said.ends_with("openjd_fail: 1 of 3 frames failed (frame 2); the others are complete\n"), "{said}");
    assert!(errors.contains("error: frame 2: a.0002.exr"), "{errors}");

    // Also of a failure before the first frame.
    std::fs::remove_file(folder.path().join("model.onnx")).expect("removed");
    let (code, said, _) = told("1", &[]);
    assert_eq!(code, Some(3));
    assert!(said.starts_with("openjd_fail: model.onnx: "), "{said}");
}

#[test]
fn existing_outputs_are_skipped_when_asked() {
    let folder = shot();
    let kept = folder.path().join("out/c.0002.exr");
    std::fs::write(&kept, b"mine").expect("output");
    let output = run(folder.path(), &shot_arguments("1-2", &["--skip-existing"]));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    assert_eq!(std::fs::read(&kept).expect("kept"), b"mine");
    assert!(stderr(&output).contains("left alone"));
}

#[test]
fn a_dry_run_writes_nothing() {
    let folder = shot();
    let output = run(folder.path(), &shot_arguments("1-3", &["--dry-run", "--json"]));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let said = String::from_utf8_lossy(&output.stdout);
    assert!(said.contains("albedo of half b from b.0003.exr"), "{said}");
    assert!(said.contains("would write out/c.0002.exr"), "{said}");
    assert!(files_in(&folder.path().join("out")).is_empty());
}

#[test]
fn a_run_says_what_the_halves_weigh() {
    let folder = shot();
    let arguments = ["a.0001.exr", "b.0001.exr", "-o", "out/c.exr", "--samples-a", "6", "--samples-b", "2"];
    let line = "samples of half a + half b: 6 + 2 (--samples-a, --samples-b); weights 0.750 + 0.250";
    let described = run(folder.path(), &[&arguments[..], &["--dry-run"]].concat());
    assert!(String::from_utf8_lossy(&described.stdout).contains(line), "{}", stderr(&described));
    let corrected = run(folder.path(), &[&arguments[..], &["--json"]].concat());
    assert!(corrected.status.success() && stderr(&corrected).contains(line), "{}", stderr(&corrected));
    let samples = &report(&folder.path().join("out/c.json"))["samples"];
    assert_eq!((samples["weights"][0].as_f64(), samples["source"].as_str()), (Some(0.75), Some("arguments")));
}

#[test]
fn quiet_says_nothing() {
    let folder = shot();
    let output = run(folder.path(), &["a.0001.exr", "b.0001.exr", "-o", "out/c.exr", "--quiet"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(output.stderr.is_empty() && output.stdout.is_empty());
}

#[test]
fn senseless_arguments_give_code_2() {
    let folder = shot();
    for arguments in [
        vec!["-o", "c.exr"],
        vec!["a.0001.exr", "--frames", "1", "-o", "c.exr"],
        vec!["--a", "a.####.exr", "--b", "b.####.exr", "--frames", "3-1", "-o", "c.####.exr"],
        vec!["--a", "a.####.exr", "--b", "b.####.exr", "--frames", "1-2", "-o", "c.exr"],
        vec!["a.0001.exr", "b.0001.exr", "-o", "c.exr", "--tile", "0"],
        vec!["a.0001.exr", "b.0001.exr", "-o", "c.exr", "--role", "albedo"],
    ] {
        let output = run(folder.path(), &arguments);
        assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", stderr(&output));
    }
}

#[test]
fn outputs_that_cannot_be_written_give_code_4() {
    let folder = shot();
    for output_path in ["nowhere/c.exr", "out", "a.0001.exr", "model.onnx"] {
        let output = run(folder.path(), &["a.0001.exr", "b.0001.exr", "-o", output_path]);
        assert_eq!(output.status.code(), Some(4), "{output_path}: {}", stderr(&output));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_fills_up_keeps_what_is_finished() {
    let folder = shot();
    // The sample's picture takes more than 64 kB: the limit stands for a full disk.
    let line = format!(
        "ulimit -f 64; trap '' XFSZ; exec {} run --model model.onnx {}",
        env!("CARGO_BIN_EXE_sspc-infer"),
        shot_arguments("1-3", &[]).iter().map(|a| format!("'{a}'")).collect::<Vec<_>>().join(" ")
    );
    let output = Command::new("bash").current_dir(folder.path()).args(["-c", &line]).output().expect("bash");
    assert_eq!(output.status.code(), Some(4), "{}", stderr(&output));
    assert!(stderr(&output).contains("not tried"), "{}", stderr(&output));
    assert!(files_in(&folder.path().join("out")).is_empty(), "nothing half-written");
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_finished_frames_and_leaves_nothing_partial() {
    let folder = shot();
    let frames: Vec<String> = (4..=60).map(|n| format!("{n:04}")).collect();
    for number in &frames {
        for half in ["a", "b"] {
            let to = folder.path().join(format!("{half}.{number}.exr"));
            std::os::unix::fs::symlink(sample(&format!("{half}.exr")), to).expect("frame");
        }
    }
    let child =
        command(folder.path(), &shot_arguments("1-60", &[])).stderr(Stdio::piped()).spawn().expect("sspc-infer runs");
    let out = folder.path().join("out");
    while !out.join("c.0002.exr").exists() {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill");
    assert!(killed.success());
    let output = child.wait_with_output().expect("it ends");
    assert_eq!(output.status.code(), Some(130), "{}", stderr(&output));
    let names = files_in(&out);
    assert!((2..60).contains(&names.len()), "{names:?}");
    for name in names {
        assert!(name.starts_with("c.") && name.ends_with(".exr"), "{name}");
        picture(&out.join(name));
    }
}

fn report(path: &Path) -> serde_json::Value {
    serde_json::from_slice(&std::fs::read(path).expect("sidecar")).expect("JSON")
}

/// Fails when a path that is not UTF-8 ends without figures, or with an empty sidecar.
#[cfg(target_os = "linux")]
#[test]
fn figures_are_written_beside_a_picture_whose_name_is_not_utf8() {
    use std::os::unix::ffi::OsStrExt;
    let folder = shot();
    let name = std::ffi::OsStr::from_bytes(b"caf\xe9.exr");
    let done = command(folder.path(), &["a.0001.exr", "b.0001.exr", "--json", "-o"]).arg(name).output().expect("runs");
    assert_eq!(done.status.code(), Some(0), "{}", stderr(&done));
    let sidecar = folder.path().join(std::ffi::OsStr::from_bytes(b"caf\xe9.json"));
    assert!(report(&sidecar)["estimate"]["corrected"]["value"].is_number());
}

/// Fails when a frame of a shot fails without its line of advice.
#[test]
fn a_frame_of_a_shot_that_fails_comes_with_advice() {
    let folder = shot();
    std::fs::write(folder.path().join("b.0002.exr"), "no picture").expect("a bad frame");
    let done = run(folder.path(), &shot_arguments("1-3", &["--quiet"]));
    assert_eq!(done.status.code(), Some(3));
    let lines = stderr(&done);
    let failed = lines.lines().position(|line| line.starts_with("error: frame 2")).expect("the frame is named");
    assert!(lines.lines().nth(failed + 1).is_some_and(|line| line.starts_with("advice: ")), "{lines}");
}

#[test]
fn an_unknown_instruction_set_ends_with_2_and_names_the_known_ones() {
    let folder = shot();
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
    command.current_dir(folder.path()).args(["run", "--model", "model.onnx", "-o", "out.exr"]);
    command.args([sample("a.exr"), sample("b.exr")]).env("SSPC_ISA", "avx3");
    let output = command.output().expect("sspc-infer starts");
    let message = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{message}");
    assert!(message.contains("SSPC_ISA: expected ") && message.contains("portable, found \"avx3\""), "{message}");
    assert!(!folder.path().join("out.exr").exists());
}

#[test]
fn further_denoised_pictures_of_a_shot_have_a_place_for_the_frame() {
    let folder = shot();
    let more = ["--denoised-more", "a.####.exr:denoised,b.####.exr:denoised", "--dry-run"];
    let output = run(folder.path(), &shot_arguments("1-2", &more));
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let told = String::from_utf8_lossy(&output.stdout).into_owned();
    assert!(told.contains("further denoised colour 1 of half b from b.0002.exr"), "{told}");
    let one = ["--denoised-more", "a.0001.exr:denoised,b.0001.exr:denoised", "--dry-run"];
    let output = run(folder.path(), &shot_arguments("1-2", &one));
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    let output = run(folder.path(), &shot_arguments("1-2", &["--denoised-more", "a.####.exr", "--dry-run"]));
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(stderr(&output).contains("ZA.exr,ZB.exr"), "{}", stderr(&output));
}

#[test]
fn a_page_stands_beside_the_pictures_and_a_reference_is_measured() {
    let folder = shot();
    for frame in [1, 2] {
        std::fs::copy(sample("ref.exr"), folder.path().join(format!("ref.{frame:04}.exr"))).expect("reference");
    }
    std::fs::remove_file(folder.path().join("b.0003.exr")).expect("removed");
    let more = ["--report", "--json", "--reference", "ref.####.exr"];
    // The third frame fails; the page shows the others.
    assert!(!run(folder.path(), &shot_arguments("1-3", &more)).status.success());
    let html = std::fs::read_to_string(folder.path().join("out/c.0001-3.html")).expect("a page");
    let (_, data) = html.split_once("id=\"data\">").expect("data");
    let data = data.split_once("</script>").expect("an end").0;
    let data: serde_json::Value = serde_json::from_str(data).expect("JSON of the page");
    let frames = data["frames"].as_array().expect("frames");
    assert_eq!((frames.len(), &data["failed"][0]["name"]), (2, &serde_json::json!("frame 3")));
    let pictures = frames[0]["pictures"].as_array().expect("pictures");
    let labels: Vec<_> = pictures.iter().map(|picture| picture["label"].as_str().expect("a label")).collect();
    let all = ["noisy", "denoised", "corrected", "reference", "error, denoised", "error, corrected", "share"];
    assert_eq!(labels, all);
    let json = std::fs::read(folder.path().join("out/c.0001.json")).expect("figures");
    let json: serde_json::Value = serde_json::from_slice(&json).expect("JSON");
    let of = |what: &str| json["rel_l2"][what].as_f64().expect("a number");
    assert!(of("corrected") < of("denoised") && of("denoised") < of("noisy"));
    assert_eq!(json["rel_l2"], frames[0]["report"]["rel_l2"]);
}
