//! `sspc-train` under what happens on farms: killed, interrupted, full disks, forbidden folders, inputs that vanish.
//! Whatever happens, a file is the old one or a whole new one, and the exit code says what it was.

use sspc_testkit::faults::{self, Moments, names_in, unfinished_in, was_interrupted};
use sspc_testkit::small_frame::SmallFrame;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::Duration;

const KILLS: usize = 50;
const INTERRUPTS: usize = 20;
/// What a fit without a reference leaves.
const OUTPUTS: [&str; 7] =
    ["comparison.png", "corrected.exr", "corrected.png", "denoised.png", "model.onnx", "noisy.png", "report.json"];

fn program() -> Command {
    Command::new(env!("CARGO_BIN_EXE_sspc-train"))
}

/// A folder with a small frame in it.
struct Desk {
    folder: tempfile::TempDir,
    frame: SmallFrame,
}

impl Desk {
    fn new() -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let frame = SmallFrame::write(folder.path(), 64, 48);
        Self { folder, frame }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// A fit of few steps into `out`.
    fn fit(&self, out: &Path, more: &[&str]) -> Command {
        let mut command = program();
        command.arg("fit").args(self.frame.arguments()).args(["--steps", "3"]).args(more).arg("-o").arg(out);
        command
    }
}

fn run(mut command: Command) -> Output {
    command.output().expect("sspc-train starts")
}

fn said(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

fn assert_code(output: &Output, code: i32, words: &[&str]) {
    let said = said(output);
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert!(said.lines().filter(|line| line.contains("error:")).count() == usize::from(code != 0), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    words.iter().for_each(|word| assert!(said.contains(word), "'{word}' in {said}"));
}

/// The model is the first file of a fit: once it is new, the others are being written.
fn has_begun_to_write(out: &Path) -> bool {
    std::fs::metadata(out.join("model.onnx")).is_ok_and(|meta| meta.len() > 1_000)
}

/// Whether a file of a fit's folder is a whole new one: the same bytes as another run's, or whole by its form where
/// it tells the time.
fn is_whole(file: &Path, like: &Path) -> bool {
    let bytes = std::fs::read(file).expect("a file");
    match file.extension().and_then(|e| e.to_str()) {
        Some("json") => serde_json::from_slice::<serde_json::Value>(&bytes).is_ok_and(|report| report["steps"] == 3),
        _ => bytes == std::fs::read(like).expect("a file"),
    }
}

#[test]
fn a_killed_fit_leaves_old_files_or_new_ones() {
    let desk = Desk::new();
    let (like, out) = (desk.path("like"), desk.path("out"));
    assert_code(&run(desk.fit(&like, &[])), 0, &[]);
    assert_eq!(names_in(&like), OUTPUTS);
    let begun = || has_begun_to_write(&out);
    let moments = Moments::of(desk.fit(&out, &[]), KILLS, begun);
    let (mut old, mut new, mut unfinished) = (0, 0, 0);
    for (kill, moment) in moments.enumerate() {
        // Every other time the folder is there, with a whole set of older files.
        let was_there = kill % 2 == 0;
        if was_there {
            std::fs::create_dir_all(&out).expect("folder");
            OUTPUTS.iter().for_each(|name| std::fs::write(out.join(name), "old").expect("written"));
        } else {
            let _ = std::fs::remove_dir_all(&out);
        }
        faults::kill_at(desk.fit(&out, &[]), moment, begun);
        for name in names_in(&out).iter().filter(|name| OUTPUTS.contains(&name.as_str())) {
            match std::fs::read(out.join(name)).expect("read") {
                bytes if bytes == b"old" => old += 1,
                _ if is_whole(&out.join(name), &like.join(name)) => new += 1,
                bytes => panic!("{name} is a part of {} bytes after kill {kill}", bytes.len()),
            }
        }
        let names = names_in(&out);
        let known = |name: &String| OUTPUTS.contains(&name.as_str()) || name.starts_with(".sspc-");
        assert!(names.iter().all(known) && (!was_there || names.len() >= OUTPUTS.len()), "{names:?}");
        unfinished += unfinished_in(&out).len();
    }
    println!("{old} old files, {new} new ones, {unfinished} unfinished ones seen");
    assert!(old > 0 && new > 0, "kills before the writing and after it: {old} old, {new} new");
    // The next run copes with whatever is left, and takes it away.
    std::fs::create_dir_all(&out).expect("folder");
    std::fs::write(out.join(".sspc-1-0.tmp"), "left by a killed run").expect("written");
    assert_code(&run(desk.fit(&out, &[])), 0, &[]);
    assert_eq!(names_in(&out), OUTPUTS);
}

#[cfg(unix)]
#[test]
fn an_interrupted_fit_leaves_nothing_or_everything() {
    let desk = Desk::new();
    let out = desk.path("out");
    let begun = || has_begun_to_write(&out);
    let moments = Moments::of(desk.fit(&out, &[]), INTERRUPTS, begun);
    let mut interrupted = 0;
    for moment in moments {
        let _ = std::fs::remove_dir_all(&out);
        let status = faults::interrupt_at(desk.fit(&out, &[]), moment, begun);
        match status.success() {
            true => assert_eq!(names_in(&out), OUTPUTS),
            false => {
                assert!(was_interrupted(status), "{status}");
                assert!(!out.exists(), "{:?}", names_in(&out));
                interrupted += 1;
            }
        }
    }
    assert!(interrupted > 0, "some signals must come before the end");
}

/// The second signal ends the process in the middle of writing; what it was writing goes with it.
#[cfg(unix)]
#[test]
fn a_second_ctrl_c_leaves_no_unfinished_file() {
    let desk = Desk::new();
    let (like, out) = (desk.path("like"), desk.path("out"));
    assert_code(&run(desk.fit(&like, &[])), 0, &[]);
    for _ in 0..INTERRUPTS {
        let _ = std::fs::remove_dir_all(&out);
        let status = faults::interrupt_twice(desk.fit(&out, &[]), || has_begun_to_write(&out));
        assert!(status.success() || was_interrupted(status), "{status}");
        assert_eq!(unfinished_in(&out), Vec::<String>::new());
        for name in names_in(&out) {
            assert!(is_whole(&out.join(&name), &like.join(&name)), "{name}");
        }
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_and_nothing_added_stays() {
    let desk = Desk::new();
    let out = desk.path("out");
    let sample = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data/sample");
    let mut larger = program();
    larger.arg("fit").args([sample.join("a.exr"), sample.join("b.exr")]).args(["--steps", "1", "-o"]).arg(&out);
    // Not even a first byte fits; the model does not; the model does, the larger frame's picture does not.
    for (kilobytes, mut command) in [(0, desk.fit(&out, &[])), (16, desk.fit(&out, &[])), (100, larger)] {
        assert_code(&faults::with_full_disk(&command, kilobytes), 4, &["cannot write"]);
        assert!(!out.exists(), "{kilobytes}: {:?}", names_in(&out));
        std::fs::create_dir(&out).expect("folder");
        std::fs::write(out.join("report.json"), "old").expect("written");
        command.arg("--quiet");
        assert_code(&faults::with_full_disk(&command, kilobytes), 4, &["cannot write"]);
        assert_eq!(names_in(&out), ["report.json"], "what was added is gone");
        assert_eq!(std::fs::read(out.join("report.json")).expect("read"), b"old");
        std::fs::remove_dir_all(&out).expect("removed");
    }
    assert_code(&run(desk.fit(&out, &[])), 0, &[]);
    let exported = desk.path("x.onnx");
    let mut export = program();
    export.arg("export").arg(&out).arg("-o").arg(&exported);
    assert_code(&faults::with_full_disk(&export, 16), 4, &["x.onnx: cannot write"]);
    assert!(!exported.exists() && unfinished_in(desk.folder.path()).is_empty());
}

#[cfg(unix)]
#[test]
fn a_folder_that_may_not_be_written_to_is_said_before_training() {
    let desk = Desk::new();
    let locked = desk.path("locked");
    std::fs::create_dir(&locked).expect("folder");
    for out in [locked.clone(), locked.join("new")] {
        let Some(command) = faults::bound_by_permissions(&locked, &desk.fit(&out, &[])) else { return };
        let output = run(command);
        assert_code(&output, 4, &["locked", "Permission denied"]);
        assert!(!said(&output).contains("training"), "{}", said(&output));
    }
    let fitted = desk.path("fitted");
    assert_code(&run(desk.fit(&fitted, &[])), 0, &[]);
    let mut export = program();
    export.arg("export").arg(&fitted).arg("-o").arg(locked.join("x.onnx"));
    let Some(export) = faults::bound_by_permissions(&locked, &export) else { return };
    assert_code(&run(export), 4, &["x.onnx", "Permission denied"]);
    assert_eq!(names_in(&locked), Vec::<String>::new());
}

#[test]
fn an_input_that_vanishes_is_named() {
    let desk = Desk::new();
    let out = desk.path("out");
    let mut command = program();
    command.arg("fit").args(desk.frame.arguments());
    command.args(["--steps", "1000000", "--time-limit", "1.5", "-o"]).arg(&out);
    let mut child = command.stderr(Stdio::piped()).spawn().expect("sspc-train starts");
    while !out.exists() && child.try_wait().expect("asked").is_none() {
        std::thread::sleep(Duration::from_millis(1));
    }
    // Everything has been read; half a is needed once more, as the template of the output.
    std::fs::remove_file(&desk.frame.a).expect("removed");
    let output = child.wait_with_output().expect("it ends");
    assert_code(&output, 3, &["a.exr", "no such file"]);
    assert!(!out.exists(), "{:?}", names_in(&out));
}

#[test]
fn nobody_listening_is_no_reason_to_stop() {
    let desk = Desk::new();
    let out = desk.path("out");
    let listeners = [Some(faults::closed_pipe()), faults::full_device()];
    for stderr in listeners.into_iter().flatten() {
        let mut command = desk.fit(&out, &[]);
        let status = command.stdout(faults::closed_pipe()).stderr(stderr).status().expect("sspc-train starts");
        assert_eq!(status.code(), Some(0));
        assert_eq!(names_in(&out), OUTPUTS);
        std::fs::remove_dir_all(&out).expect("removed");
        // A failure that nobody hears still has its code.
        let mut command = desk.fit(&out, &["--role", "albedo=missing.exr"]);
        let status = command.stderr(faults::closed_pipe()).status().expect("sspc-train starts");
        assert_eq!(status.code(), Some(3));
    }
}

#[test]
fn no_input_is_ever_an_output() {
    let desk = Desk::new();
    let fitted = desk.path("fitted");
    assert_code(&run(desk.fit(&fitted, &[])), 0, &[]);
    let before = |name: &str| std::fs::read(fitted.join(name)).expect("read");
    let (model, picture) = (before("model.onnx"), before("corrected.exr"));
    let text = |name: &str| fitted.join(name).display().to_string();
    let roles = ["radiance-a", "denoised-b", "denoised-full"].map(|role| format!("{role}={}", text("corrected.exr")));
    // A model to start from may be refined in place, not taken for another output.
    std::fs::copy(fitted.join("model.onnx"), fitted.join("report.json")).expect("copied");
    let init = text("report.json");
    let mut cases: Vec<Vec<&str>> = roles.iter().map(|role| vec!["--role", role.as_str()]).collect();
    cases.push(vec!["--init", &init]);
    for more in cases {
        let output = run(desk.fit(&fitted, &more));
        assert_code(&output, 4, &["an output that is no input"]);
        assert!(!said(&output).contains("training"), "{more:?} is found late");
    }
    // The frame's own files under the names of outputs.
    let twin = desk.path("twin");
    std::fs::create_dir(&twin).expect("folder");
    std::fs::hard_link(&desk.frame.b, twin.join("noisy.png")).expect("linked");
    assert_code(&run(desk.fit(&twin, &[])), 4, &["noisy.png", "an output that is no input"]);
    let mut export = program();
    export.arg("export").arg(&fitted).arg("-o").arg(fitted.join("model.onnx"));
    assert_code(&run(export), 4, &["an output that is no input"]);
    assert_eq!((before("model.onnx"), before("corrected.exr")), (model, picture));
}

#[cfg(unix)]
#[test]
fn links_are_not_followed_out_of_the_folder() {
    use std::os::unix::fs::symlink;
    let desk = Desk::new();
    let (out, precious) = (desk.path("out"), desk.path("precious"));
    std::fs::create_dir(&out).expect("folder");
    std::fs::write(&precious, "precious").expect("written");
    for name in OUTPUTS {
        symlink(&precious, out.join(name)).expect("linked");
        let output = run(desk.fit(&out, &[]));
        assert_code(&output, 4, &[name, "symbolic link"]);
        assert!(!said(&output).contains("training"), "{name} is found late");
        std::fs::remove_file(out.join(name)).expect("removed");
        assert_eq!(names_in(&out), Vec::<String>::new());
    }
    // Also where it leads nowhere yet.
    symlink(desk.path("not-there"), out.join("model.onnx")).expect("linked");
    assert_code(&run(desk.fit(&out, &[])), 4, &["symbolic link"]);
    assert!(!desk.path("not-there").exists());
    assert_eq!(std::fs::read_to_string(&precious).expect("read"), "precious");
}
