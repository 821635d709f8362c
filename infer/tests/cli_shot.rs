//! Shots as a person or a farm runs and measures them: chunks, neighbours that are missing or of no use, motion passes that
//! say nothing.

use sspc_cli::shot::settings::ShotSettings;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_frames::read_picture;
use sspc_image::Image;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model, write_network};
use sspc_shots::convention::{Convention, Unit};
use sspc_testkit::exr_parts::write_picture;
use sspc_testkit::made_shot::MadeFrame;
use std::path::Path;
use std::process::{Command, Output};

const PREVIOUS: Convention = Convention { first: 0, unit: Unit::Pixel, right: 1, down: -1 };
const NEXT: Convention = Convention { first: 2, unit: Unit::Pixel, right: -1, down: 1 };

/// The analytic start as a model of single frames and as one of a shot.
fn write_models(folder: &Path) {
    let mut contract = Contract::new(Form::Gated);
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    let single = Model::new(contract.clone(), weights.clone()).expect("a model");
    std::fs::write(folder.join("single.onnx"), write_network(&single)).expect("model");
    let settings = ShotSettings { extra_frames: 1, motion: [Some(PREVIOUS), Some(NEXT)] };
    contract.extra_frames = settings.extra_frames;
    contract.extra.extend(settings.to_model());
    let shot = Model::new(contract, weights).expect("a model");
    std::fs::write(folder.join("shot.onnx"), write_network(&shot)).expect("model");
}

/// Frames 1 to 4 and both models.
fn shot() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("folder");
    write_models(folder.path());
    (1..=4).for_each(|number| drop(MadeFrame::new(number).write(folder.path())));
    folder
}

fn infer(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
    command.current_dir(folder).args(arguments).output().expect("sspc-infer runs")
}

/// Corrects frames into a folder; what was printed.
fn run(folder: &Path, model: &str, frames: &str, out: &str, more: &[&str]) -> String {
    std::fs::create_dir_all(folder.join(out)).expect("out");
    let pattern = format!("{out}/c.####.exr");
    let mut arguments = vec!["run", "--model", model, "--a", "a.####.exr", "--b", "b.####.exr", "--json"];
    arguments.extend(["--frames", frames, "-o", &pattern]);
    arguments.extend(more);
    let output = infer(folder, &arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(0), "{said}");
    said
}

fn picture(folder: &Path, out: &str, number: i32) -> Image {
    read_picture(&folder.join(format!("{out}/c.{number:04}.exr")), None).expect("a picture")
}

/// What the figures of a frame say of its neighbours: number, motion, why it was left out.
fn neighbours(folder: &Path, out: &str, number: i32) -> Vec<(i64, String, Option<String>)> {
    let text = std::fs::read_to_string(folder.join(format!("{out}/c.{number:04}.json"))).expect("figures");
    let figures: serde_json::Value = serde_json::from_str(&text).expect("JSON");
    let list = figures["neighbours"].as_array().cloned().unwrap_or_default();
    let of = |one: &serde_json::Value| {
        let motion = one["motion"].as_str().unwrap_or("-").to_string();
        (one["frame"].as_i64().expect("a number"), motion, one["left_out"].as_str().map(str::to_string))
    };
    list.iter().map(of).collect()
}

#[test]
fn every_chunk_of_a_shot_gives_the_same_pixels() {
    let shot = shot();
    let folder = shot.path();
    run(folder, "shot.onnx", "1-4", "all", &[]);
    run(folder, "shot.onnx", "2", "one", &[]);
    run(folder, "shot.onnx", "4,3", "back", &["--threads", "1"]);
    for (out, number) in [("one", 2), ("back", 3), ("back", 4)] {
        assert_eq!(picture(folder, out, number), picture(folder, "all", number), "frame {number} of {out}");
    }
    let (before, after) = (PREVIOUS.to_string(), NEXT.to_string());
    assert_eq!(neighbours(folder, "all", 1), [(2, after.clone(), None)]);
    assert_eq!(neighbours(folder, "all", 3), [(2, before, None), (4, after, None)]);
    // The neighbours have changed the picture, for the better.
    run(folder, "single.onnx", "3", "single", &[]);
    let truth = MadeFrame::new(3).truth();
    let error = |out| {
        let own = picture(folder, out, 3);
        own.data().iter().zip(truth.data()).map(|(x, r)| f64::from(x - r).powi(2)).sum::<f64>()
    };
    assert!(error("all") < 0.8 * error("single"), "{} {}", error("all"), error("single"));
}

#[test]
fn without_extra_frames_a_frame_is_by_itself() {
    let shot = shot();
    run(shot.path(), "single.onnx", "2", "single", &[]);
    let said = run(shot.path(), "shot.onnx", "2", "none", &["--extra-frames", "0"]);
    assert!(said.contains("fitted with 1 neighbouring frames"), "{said}");
    assert_eq!(picture(shot.path(), "none", 2), picture(shot.path(), "single", 2));
    assert!(neighbours(shot.path(), "none", 2).is_empty());
}

#[test]
fn neighbours_that_are_missing_or_damaged_are_left_out() {
    let shot = shot();
    let folder = shot.path();
    std::fs::remove_file(folder.join("a.0001.exr")).expect("remove");
    let whole = std::fs::read(folder.join("a.0003.exr")).expect("read");
    std::fs::write(folder.join("a.0003.exr"), &whole[..whole.len() / 3]).expect("write");
    let said = run(folder, "shot.onnx", "2", "out", &[]);
    assert!(said.contains("neighbouring frame 3 is left out") && said.contains("a.0003.exr"), "{said}");
    run(folder, "single.onnx", "2", "single", &[]);
    assert_eq!(picture(folder, "out", 2), picture(folder, "single", 2));
}

#[test]
fn neighbours_of_another_size_or_scene_are_left_out() {
    let shot = shot();
    let folder = shot.path();
    MadeFrame { size: (80, 128), ..MadeFrame::new(1) }.write(folder);
    MadeFrame { is_other_scene: true, ..MadeFrame::new(3) }.write(folder);
    let said = run(folder, "shot.onnx", "2", "out", &[]);
    assert!(said.contains("128x80 pixels, the frame 128x96"), "{said}");
    let [(1, _, Some(size)), (3, _, Some(scene))] = &neighbours(folder, "out", 2)[..] else {
        panic!("{:?}", neighbours(folder, "out", 2))
    };
    assert!(size.contains("pixels") && scene.contains("something else"), "{size}; {scene}");
}

#[test]
fn seeds_shared_with_the_other_half_of_a_neighbour_are_found() {
    let shot = shot();
    let folder = shot.path();
    MadeFrame { seeds: [MadeFrame::new(2).seeds[1], 99], ..MadeFrame::new(3) }.write(folder);
    let said = run(folder, "shot.onnx", "2", "out", &[]);
    assert!(said.contains("neighbouring frame 3 is left out: noise of one of its halves"), "{said}");
    let found = neighbours(folder, "out", 2);
    assert!(found[0].2.is_none() && found[1].2.is_some(), "{found:?}");
}

#[test]
fn a_motion_pass_that_says_nothing_or_leads_elsewhere_is_not_used() {
    let shot = shot();
    let folder = shot.path();
    MadeFrame { motion: 0.0, ..MadeFrame::new(2) }.write(folder);
    MadeFrame { motion: -3.0, ..MadeFrame::new(3) }.write(folder);
    run(folder, "shot.onnx", "2-3", "out", &[]);
    for number in [2, 3] {
        let found = neighbours(folder, "out", number);
        assert!(found.iter().all(|(_, motion, left)| motion == "estimated" && left.is_none()), "{found:?}");
    }
    run(folder, "shot.onnx", "2", "none", &["--role", "motion=none"]);
    assert_eq!(picture(folder, "none", 2), picture(folder, "out", 2));
}

#[test]
fn positions_and_cameras_tell_motion_where_a_pass_does_not() {
    let shot = shot();
    let folder = shot.path();
    let write = |number, seen| drop(MadeFrame { seen, ..MadeFrame::new(number) }.write(folder));
    let motion = |out: &str, more: &[&str]| {
        run(folder, "shot.onnx", "2", out, &[&["--role", "motion=none"], more].concat());
        neighbours(folder, out, 2).into_iter().map(|(_, motion, left)| (motion, left.is_none())).collect::<Vec<_>>()
    };
    let estimated = |why: &str| (format!("estimated (position: {why})"), true);
    let plain = motion("plain", &[]);
    assert_eq!(plain, [("estimated".to_string(), true), ("estimated".to_string(), true)]);
    // A layer of that name alone changes nothing, nor does a neighbour without a camera, or with another's.
    write(2, Some((2, None)));
    assert_eq!(motion("lonely", &[]), [0, 1].map(|_| estimated("the file has no camera matrix (worldToNDC)")));
    write(2, Some((2, Some(2))));
    write(3, Some((3, Some(2))));
    let off = estimated("in the neighbour the camera matrix lays it 2.8 pixels off its own pixels");
    assert_eq!(motion("wrong", &[]), [estimated("the neighbour has none"), off]);
    // What moves itself, seen by a camera that stands still.
    (1..=3).for_each(|number| write(number, Some((2, Some(2)))));
    assert_eq!(motion("still", &[]), [0, 1].map(|_| estimated("it lays features over each other less well")));
    for out in ["lonely", "wrong", "still"] {
        assert_eq!(picture(folder, out, 2), picture(folder, "plain", 2), "{out}");
    }
    // Both have one.
    (1..=3).for_each(|number| write(number, Some((number, Some(number)))));
    assert_eq!(motion("seen", &[]), [0, 1].map(|_| ("position".to_string(), true)));
    assert_ne!(picture(folder, "seen", 2), picture(folder, "plain", 2));
    assert_eq!(motion("none", &["--role", "position=none"]), plain);
    assert_eq!(picture(folder, "none", 2), picture(folder, "plain", 2));
    // The motion pass says the same, and goes first.
    run(folder, "shot.onnx", "2", "pass", &[]);
    assert_eq!(neighbours(folder, "pass", 2)[0].1, PREVIOUS.to_string());
    let (seen, pass) = (picture(folder, "seen", 2), picture(folder, "pass", 2));
    let apart = seen.data().iter().zip(pass.data()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(apart < 0.01, "{apart}");
}

#[test]
fn a_shot_is_measured_frame_by_frame_and_as_a_whole() {
    let folder = tempfile::tempdir().expect("folder");
    let path = folder.path();
    for number in 1..=3 {
        let truth = MadeFrame::new(number).truth();
        let shifted = |by: f32| Image::from_fn(3, 96, 128, |c, y, x| truth.at(c, y, x) + by);
        write_picture(&path.join(format!("r.{number}.exr")), &truth);
        // A constant error, and one that flickers.
        write_picture(&path.join(format!("x.{number}.exr")), &shifted(0.1));
        write_picture(&path.join(format!("z.{number}.exr")), &shifted(if number == 2 { 0.2 } else { 0.1 }));
    }
    let arguments = ["evaluate", "x.#.exr", "--reference", "r.#.exr", "--denoised", "z.#.exr", "--frames", "1-3"];
    let output = infer(path, &[&arguments[..], &["--json"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let found: serde_json::Value = serde_json::from_slice(&output.stdout).expect("JSON");
    assert!(found["temporal"].as_f64().unwrap() < 1e-4, "{found:#}");
    assert!(found["denoised"]["temporal"].as_f64().unwrap() > 1e-2, "{found:#}");
    let steps: Vec<bool> =
        found["frames"].as_array().unwrap().iter().map(|frame| frame["temporal"].is_null()).collect();
    assert_eq!(steps, [true, false, false]);
    let share = found["frames"][1]["temporal"]["share"].as_f64().unwrap();
    assert!((0.8..1.0).contains(&share), "{share}");
    let table = infer(path, &arguments);
    assert!(String::from_utf8_lossy(&table.stdout).lines().last().unwrap().starts_with("shot"));
}

#[test]
fn the_page_of_a_shot_has_the_flicker_that_evaluate_measures() {
    let shot = shot();
    let folder = shot.path();
    (1..=4).for_each(|n| write_picture(&folder.join(format!("ref.{n:04}.exr")), &MadeFrame::new(n).truth()));
    run(folder, "single.onnx", "1,2,4", "out", &["--report", "--reference", "ref.####.exr"]);
    let page = std::fs::read_to_string(folder.join("out/c.0001-4.html")).expect("a page");
    let (_, data) = page.split_once("id=\"data\">").expect("data");
    let data: serde_json::Value = serde_json::from_str(data.split_once("</script>").expect("its end").0).expect("JSON");
    let told = |at: usize| &data["frames"][at]["report"]["temporal"];
    // Frame 1 has none before it, and 4 does not follow 2.
    assert!(told(0).is_null() && told(2).is_null());

    let measured =
        infer(folder, &["evaluate", "out/c.####.exr", "--reference", "ref.####.exr", "--frames", "1-2", "--json"]);
    let measured: serde_json::Value = serde_json::from_slice(&measured.stdout).expect("JSON");
    let step = &measured["frames"][1]["temporal"];
    assert!(step["picture"].as_f64() > Some(0.0) && step["picture"] == told(1)["picture"], "{step} {}", told(1));
    assert_eq!(step["share"], told(1)["share"]);
    let denoised = &told(1)["denoised"];
    assert!(denoised.as_f64() > Some(0.0) && denoised != &step["picture"], "{}", told(1));
}
