//! `sspc-infer` under what happens on farms: killed, interrupted, full disks, forbidden folders, inputs that vanish,
//! closed pipes, long sequences. Whatever happens, a file is the old one or a whole new one, and the exit code says
//! what it was.

use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_frames::read_picture;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model, write_network};
use sspc_testkit::faults::{self, Moments, names_in, unfinished_in, was_interrupted};
use sspc_testkit::small_frame::SmallFrame;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

const KILLS: usize = 50;
const INTERRUPTS: usize = 20;

/// A folder with a small frame, a model and a place for outputs.
struct Desk {
    folder: tempfile::TempDir,
    frame: SmallFrame,
}

impl Desk {
    fn new() -> Self {
        Self::of_size(160, 120)
    }

    fn of_size(width: usize, height: usize) -> Self {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let frame = SmallFrame::write(folder.path(), width, height);
        let contract = Contract::new(Form::Gated);
        let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
        let model = Model::new(contract, weights).expect("a model");
        std::fs::write(folder.path().join("model.onnx"), write_network(&model)).expect("written");
        std::fs::create_dir(folder.path().join("out")).expect("folder");
        Self { folder, frame }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn program(&self, subcommand: &str) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
        command.current_dir(self.folder.path()).arg(subcommand);
        command
    }

    /// Corrects the frame into `output`, relative to the folder.
    fn run(&self, output: &str, more: &[&str]) -> Command {
        let mut command = self.program("run");
        command.args(["--model", "model.onnx"]).args(self.frame.arguments()).args(more).args(["-o", output]);
        command
    }

    /// Measures half a against its denoised picture, with an error map.
    fn evaluate(&self, map: &str) -> Command {
        let mut command = self.program("evaluate");
        command.args(["a.exr", "--reference", "za.exr", "--error-map", map]);
        command
    }
}

fn output(mut command: Command) -> Output {
    command.output().expect("sspc-infer starts")
}

fn assert_code(output: &Output, code: i32, words: &[&str]) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{said}");
    assert!(!said.contains("panicked"), "{said}");
    words.iter().for_each(|word| assert!(said.contains(word), "'{word}' in {said}"));
}

/// Something is being written, or has been: anything longer than "old".
fn has_begun_to_write(out: &Path) -> bool {
    names_in(out)
        .iter()
        .any(|name| name.starts_with(".sspc-") || std::fs::metadata(out.join(name)).is_ok_and(|meta| meta.len() > 3))
}

/// Whether an output of the frame is a whole new one.
fn is_whole(file: &Path, like: &Path) -> bool {
    let bytes = std::fs::read(file).expect("a file");
    match file.extension().and_then(|e| e.to_str()) {
        Some("json") => serde_json::from_slice::<serde_json::Value>(&bytes).is_ok_and(|report| report["width"] == 160),
        _ => bytes == std::fs::read(like).expect("a file"),
    }
}

/// Kills `command`, which writes `files` into the folder `out`, at 50 moments.
fn assert_survives_kills(desk: &Desk, files: &[&str], command: impl Fn() -> Command) {
    let (out, like) = (desk.path("out"), desk.path("like"));
    let begun = || has_begun_to_write(&out);
    let moments = Moments::of(command(), KILLS, begun);
    assert_eq!(names_in(&out), files);
    std::fs::create_dir(&like).expect("folder");
    for name in files {
        std::fs::copy(out.join(name), like.join(name)).expect("copied");
    }
    let (mut old, mut new, mut absent, mut unfinished) = (0, 0, 0, 0);
    for (kill, moment) in moments.enumerate() {
        // Every other time the files are there already.
        let was_there = kill % 2 == 0;
        for name in files {
            match was_there {
                true => std::fs::write(out.join(name), "old").expect("written"),
                false => drop(std::fs::remove_file(out.join(name))),
            }
        }
        faults::kill_at(command(), moment, begun);
        for name in files {
            match std::fs::read(out.join(name)) {
                Err(_) => {
                    assert!(!was_there, "{name} is gone after kill {kill}");
                    absent += 1;
                }
                Ok(bytes) if bytes == b"old" => old += 1,
                Ok(_) if is_whole(&out.join(name), &like.join(name)) => new += 1,
                Ok(bytes) => panic!("{name} is a part of {} bytes after kill {kill}", bytes.len()),
            }
        }
        unfinished += unfinished_in(&out).len();
        // The next run would take it away; here each kill is looked at by itself.
        unfinished_in(&out).iter().for_each(|name| std::fs::remove_file(out.join(name)).expect("removed"));
    }
    println!("{old} old files, {new} new ones, {absent} absent ones, {unfinished} unfinished ones seen");
    assert!(old > 0 && new > 0, "kills before the writing and after it: {old} old, {new} new");
    std::fs::write(out.join(".sspc-1-0.tmp"), "left by a killed run").expect("written");
    assert_code(&output(command()), 0, &[]);
    assert_eq!(names_in(&out), files, "the next run takes away what killed ones left");
}

#[test]
fn a_killed_run_leaves_old_files_or_new_ones() {
    let desk = Desk::new();
    assert_survives_kills(&desk, &["c.exr", "c.json"], || desk.run("out/c.exr", &["--json"]));
}

#[test]
fn a_killed_evaluation_leaves_the_old_map_or_the_new_one() {
    let desk = Desk::new();
    assert_survives_kills(&desk, &["map.png"], || desk.evaluate("out/map.png"));
}

#[cfg(unix)]
#[test]
fn an_interrupted_run_leaves_nothing_unfinished() {
    let desk = Desk::new();
    let out = desk.path("out");
    let begun = || has_begun_to_write(&out);
    let mut interrupted = 0;
    for moment in Moments::of(desk.run("out/c.exr", &[]), INTERRUPTS, begun) {
        let _ = std::fs::remove_file(out.join("c.exr"));
        let status = faults::interrupt_at(desk.run("out/c.exr", &[]), moment, begun);
        assert!(status.success() || was_interrupted(status), "{status}");
        interrupted += u32::from(!status.success());
        assert!(unfinished_in(&out).is_empty());
        let written = out.join("c.exr").exists();
        assert!(!written || read_picture(&out.join("c.exr"), None).is_ok());
        assert!(written || !status.success());
    }
    assert!(interrupted > 0, "some signals must come before the end");
    for _ in 0..INTERRUPTS {
        // The second signal ends the process in the middle of writing; what it was writing goes with it.
        let _ = std::fs::remove_file(out.join("c.exr"));
        let status = faults::interrupt_twice(desk.run("out/c.exr", &[]), begun);
        assert!(status.success() || was_interrupted(status), "{status}");
        assert!(unfinished_in(&out).is_empty(), "{:?}", names_in(&out));
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_and_leaves_the_old_file() {
    let desk = Desk::new();
    let out = desk.path("out");
    for name in ["c.exr", "map.png"] {
        std::fs::write(out.join(name), "old").expect("written");
    }
    for (command, file) in [(desk.run("out/c.exr", &[]), "c.exr"), (desk.evaluate("out/map.png"), "map.png")] {
        let output = faults::with_full_disk(&command, 4);
        assert_code(&output, 4, &[file, "cannot write"]);
        assert!(output.stdout.is_empty());
        assert_eq!(std::fs::read(out.join(file)).expect("read"), b"old");
    }
    assert_eq!(names_in(&out), ["c.exr", "map.png"]);
}

#[cfg(unix)]
#[test]
fn a_folder_that_may_not_be_written_to_is_said() {
    let desk = Desk::new();
    let out = desk.path("out");
    for (command, file) in [(desk.run("out/c.exr", &[]), "c.exr"), (desk.evaluate("out/map.png"), "map.png")] {
        let Some(mut bound) = faults::bound_by_permissions(&out, &command) else { return };
        bound.current_dir(desk.folder.path());
        assert_code(&output(bound), 4, &[file, "Permission denied"]);
        assert!(names_in(&out).is_empty());
    }
}

#[test]
fn an_input_that_vanishes_is_named() {
    let desk = Desk::of_size(640, 480);
    let mut command = desk.run("out/c.exr", &["--verbose"]);
    let mut child = command.stderr(Stdio::piped()).spawn().expect("sspc-infer starts");
    let mut lines = BufReader::new(child.stderr.take().expect("piped"));
    let mut said = String::new();
    // The size is told once everything is read; half a is needed once more, as the template of the output.
    while !said.contains("640 x 480") && lines.read_line(&mut said).expect("read") > 0 {}
    std::fs::remove_file(&desk.frame.a).expect("removed");
    lines.read_to_string(&mut said).expect("read");
    let status = child.wait().expect("it ends");
    assert_eq!(status.code(), Some(3), "{said}");
    assert!(said.contains("a.exr: no such file"), "{said}");
    assert!(names_in(&desk.path("out")).is_empty());
}

#[test]
fn a_closed_or_full_standard_output_is_said() {
    let desk = Desk::new();
    let mut info = desk.program("info");
    info.arg("model.onnx");
    let mut evaluate = desk.program("evaluate");
    evaluate.args(["a.exr", "--reference", "za.exr"]);
    for mut command in [info, evaluate, desk.run("out/c.exr", &["--dry-run"])] {
        for stdout in [Some(faults::closed_pipe()), faults::full_device()].into_iter().flatten() {
            let child = command.stdout(stdout).stderr(Stdio::piped()).spawn().expect("sspc-infer starts");
            let output = child.wait_with_output().expect("it ends");
            assert_code(&output, 4, &["standard output: cannot write"]);
        }
    }
}

#[test]
fn nobody_listening_is_no_reason_to_stop() {
    let desk = Desk::new();
    for stderr in [Some(faults::closed_pipe()), faults::full_device()].into_iter().flatten() {
        let mut command = desk.run("out/c.exr", &["--verbose"]);
        let status = command.stdout(faults::closed_pipe()).stderr(stderr).status().expect("sspc-infer starts");
        assert_eq!(status.code(), Some(0));
        assert_eq!(names_in(&desk.path("out")), ["c.exr"]);
        std::fs::remove_file(desk.path("out/c.exr")).expect("removed");
    }
    let status = desk.run("out/c.exr", &["--role", "albedo=no.exr"]).stderr(faults::closed_pipe()).status();
    assert_eq!(status.expect("sspc-infer starts").code(), Some(3), "a failure that nobody hears has its code");
}

#[test]
fn no_input_is_ever_an_output() {
    let desk = Desk::new();
    std::fs::hard_link(desk.path("b.exr"), desk.path("out/linked.exr")).expect("linked");
    std::fs::copy(desk.path("a.exr"), desk.path("role.exr")).expect("copied");
    std::fs::copy(desk.path("za.exr"), desk.path("full.exr")).expect("copied");
    let inputs = ["a.exr", "b.exr", "za.exr", "zb.exr", "full.exr", "role.exr", "model.onnx", "out/linked.exr"];
    let before = inputs.map(|name| std::fs::read(desk.path(name)).expect("read"));
    let more = ["--denoised", "full.exr", "--role", "radiance-a=role.exr"];
    for name in inputs {
        assert_code(&output(desk.run(name, &more)), 4, &["an output that is no input"]);
    }
    assert_code(&output(desk.evaluate("a.exr")), 4, &["an output that is no input"]);
    assert_code(&output(desk.evaluate("za.exr")), 4, &["an output that is no input"]);
    // The sidecar as well: it is called as the picture, with another ending.
    std::fs::rename(desk.path("role.exr"), desk.path("role.json")).expect("renamed");
    std::fs::hard_link(desk.path("b.exr"), desk.path("out/x.json")).expect("linked");
    assert_code(&output(desk.run("out/x.exr", &["--json"])), 4, &["x.json", "an output that is no input"]);
    std::fs::rename(desk.path("role.json"), desk.path("role.exr")).expect("renamed");
    assert_eq!(inputs.map(|name| std::fs::read(desk.path(name)).expect("read")), before);
}

#[cfg(unix)]
#[test]
fn links_are_not_followed_out_of_the_folder() {
    use std::os::unix::fs::symlink;
    let desk = Desk::new();
    let (out, precious) = (desk.path("out"), desk.path("precious"));
    std::fs::write(&precious, "precious").expect("written");
    for name in ["c.exr", "c.json", "map.png"] {
        symlink(&precious, out.join(name)).expect("linked");
        let command = if name == "map.png" { desk.evaluate("out/map.png") } else { desk.run("out/c.exr", &["--json"]) };
        assert_code(&output(command), 4, &[name, "symbolic link"]);
        std::fs::remove_file(out.join(name)).expect("removed");
        assert!(names_in(&out).is_empty());
    }
    assert_eq!(std::fs::read_to_string(&precious).expect("read"), "precious");
}

const FRAMES: usize = 200;
const BAD_FRAME: usize = 100;
/// Memory of the first frames is that of all, but for what the allocator keeps (8 MiB on a busy machine): 180 more frames, whose files and pictures
/// take 60 MiB together, would show.
const MOST_GROWTH_BYTES: u64 = 20 << 20;

/// A long shot: every frame that can be corrected is, the bad one is named, and memory stays what it was.
#[test]
fn two_hundred_frames_take_the_memory_of_a_few() {
    let desk = Desk::of_size(96, 64);
    for name in ["a", "b", "za", "zb"] {
        for frame in 1..=FRAMES {
            let to = desk.path(&format!("{name}.{frame:04}.exr"));
            std::fs::hard_link(desk.path(&format!("{name}.exr")), to).expect("linked");
        }
    }
    let bad = desk.path(&format!("b.{BAD_FRAME:04}.exr"));
    std::fs::remove_file(&bad).expect("removed");
    std::fs::write(&bad, "cut off").expect("written");
    let mut command = desk.program("run");
    command.args(["--model", "model.onnx", "--a", "a.####.exr", "--b", "b.####.exr"]);
    command.args(["--denoised-a", "za.####.exr", "--denoised-b", "zb.####.exr"]);
    let output = output({
        command.args(["--frames", "1-200", "--json", "-o", "out/c.####.exr"]);
        command
    });
    assert_code(&output, 3, &["frame 100: b.0100.exr", "1 of 200 frames failed"]);
    assert_eq!(names_in(&desk.path("out")).len(), 2 * (FRAMES - 1));
    let peak = |frame: usize| {
        let bytes = std::fs::read(desk.path(&format!("out/c.{frame:04}.json"))).expect("a sidecar");
        let report: serde_json::Value = serde_json::from_slice(&bytes).expect("JSON");
        report["peak_rss_bytes"].as_u64()
    };
    let (Some(early), Some(late)) = (peak(20), peak(FRAMES)) else {
        eprintln!("skipped: this system does not tell a process's memory");
        return;
    };
    println!("peak memory after 20 frames {} KiB, after {FRAMES} {} KiB", early >> 10, late >> 10);
    // The system counts in batches: the later reading may be the lower one.
    assert!(late.saturating_sub(early) <= MOST_GROWTH_BYTES, "{early} bytes after 20 frames, {late} after {FRAMES}");
}
