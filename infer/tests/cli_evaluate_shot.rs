//! `sspc-infer evaluate --frames` as a person or a farm runs it: JOD of the video, what is left out, the plot.

use serde_json::Value;
use sspc_image::Image;
use sspc_testkit::exr_parts::write_picture;
use sspc_testkit::made_shot::MadeFrame;
use std::path::Path;
use std::process::{Command, Output};

/// Frames of the shot.
const COUNT: i32 = 6;
const SIZE: (usize, usize) = (48, 64);

/// References `r.N.exr`, the same as `z.N.exr` with an error that flickers, and as `x.N.exr` with one that changes its
/// sign half as often.
fn shot() -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("folder");
    for number in 1..=COUNT {
        let truth = MadeFrame { size: SIZE, ..MadeFrame::new(number) }.truth();
        // Most of it a factor on the whole picture, which is seen where it changes; the pattern is seen in a still too.
        let pattern = |y: usize, x: usize| 1.0 + 0.3 * (0.5 * x as f32).sin() * (0.4 * y as f32).sin();
        let wrong =
            |by: f32| Image::from_fn(3, SIZE.0, SIZE.1, |c, y, x| truth.at(c, y, x) * (1.0 + by * pattern(y, x)));
        let write =
            |name: &str, picture: &Image| write_picture(&folder.path().join(format!("{name}.{number}.exr")), picture);
        write("r", &truth);
        write("z", &wrong(if number % 2 == 0 { 0.06 } else { -0.06 }));
        write("x", &wrong(if number <= COUNT / 2 { 0.06 } else { -0.06 }));
    }
    folder
}

fn evaluate(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
    command.current_dir(folder).arg("evaluate").args(arguments).output().expect("sspc-infer runs")
}

/// The figures of a pattern, with further arguments.
fn measured(folder: &Path, picture: &str, more: &[&str]) -> Value {
    let arguments = [&[picture, "--reference", "r.#.exr", "--json"], more].concat();
    let output = evaluate(folder, &arguments);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("JSON")
}

fn jod(found: &Value) -> f64 {
    found["jod"].as_f64().unwrap_or_else(|| panic!("no JOD in {found:#}"))
}

/// Exit code, and a first line on standard error that holds the words.
fn assert_fails(output: &Output, code: i32, words: &[&str]) {
    let error = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(code), "{error}");
    words.iter().for_each(|word| assert!(error.contains(word), "'{word}' in {error}"));
    assert!(output.stdout.is_empty());
}

#[test]
fn identical_pictures_are_ten_and_an_error_takes_from_it() {
    let shot = shot();
    let folder = shot.path();
    let same = measured(folder, "r.#.exr", &["--frames", "1-6"]);
    assert_eq!(jod(&same), 10.0);
    assert!(same["frames"].as_array().unwrap().iter().all(|frame| frame["jod"]["picture"] == 10.0), "{same:#}");
    assert_eq!(
        (&same["viewing"]["frames_per_second"], &same["viewing"]["display"]),
        (&24.0.into(), &"standard_4k".into())
    );

    let wrong = measured(folder, "x.#.exr", &["--frames", "1-6", "--denoised", "z.#.exr"]);
    let (own, flickers) = (jod(&wrong), wrong["denoised"]["jod"].as_f64().unwrap());
    // The same size of error in every frame: only the order of the signs differs.
    assert!(own < 9.9 && flickers < own - 0.1, "{own} {flickers}");
    for frame in wrong["frames"].as_array().unwrap() {
        assert!(frame["jod"]["picture"].as_f64().unwrap() < 10.0 && frame["jod"]["denoised"].is_number(), "{frame:#}");
    }
    let slow = measured(folder, "x.#.exr", &["--frames", "1-6", "--fps", "2"]);
    assert!((jod(&slow) - own).abs() > 1e-3, "the rate matters");
}

#[test]
fn a_shot_is_shown_with_one_exposure() {
    let shot = shot();
    let folder = shot.path();
    let found = measured(folder, "x.#.exr", &["--frames", "1-6"]);
    let all: Vec<&Value> = found["frames"].as_array().unwrap().iter().map(|frame| &frame["exposure"]).collect();
    assert!(all.iter().all(|one| *one == &found["viewing"]["exposure"]), "{all:?}");
    let told = measured(folder, "x.#.exr", &["--frames", "1-6", "--exposure", "0.25"]);
    assert_eq!(told["viewing"]["exposure"], 0.25);
    assert_ne!(jod(&told), jod(&found));
}

#[test]
fn what_is_left_out_is_said_with_its_reason() {
    let shot = shot();
    let folder = shot.path();
    let found = measured(folder, "x.#.exr", &["--frames", "1-3,6"]);
    let three =
        measured(folder, "x.#.exr", &["--frames", "1-3", "--exposure", &found["viewing"]["exposure"].to_string()]);
    assert!((jod(&found) - jod(&three)).abs() < 1e-6, "frame 6 has no part in it");
    let left_out = found["left_out"].as_array().unwrap();
    let told: Vec<_> = left_out.iter().map(|one| (one["frame"].as_i64().unwrap(), &one["figure"])).collect();
    assert_eq!(told, [(6, &"temporal".into()), (6, &"jod".into())]);
    assert!(left_out[0]["why"].as_str().unwrap().contains("frame 3 is before it"), "{left_out:?}");
    assert!(found["frames"][3]["jod"].is_null());

    let table = evaluate(folder, &["x.#.exr", "--reference", "r.#.exr", "--frames", "1-3,6"]);
    let table = String::from_utf8_lossy(&table.stdout).into_owned();
    assert!(table.starts_with("JOD: ColorVideoVDP 0.5.7, standard_4k, 24 frames per second"), "{table}");
    assert!(table.contains("frame 6 without jod: it neither follows a frame nor is followed"), "{table}");

    let alone = measured(folder, "x.#.exr", &["--frames", "2"]);
    assert!(alone["jod"].is_null() && alone["left_out"][0]["figure"] == "jod", "{alone:#}");

    // From frame 4 on the shot has another size.
    for number in 4..=COUNT {
        for name in ["r", "x"] {
            let picture = MadeFrame { size: (40, 64), ..MadeFrame::new(number) }.truth();
            write_picture(&folder.join(format!("{name}.{number}.exr")), &picture);
        }
    }
    let resized = measured(folder, "x.#.exr", &["--frames", "1-6"]);
    let [one] = &resized["left_out"].as_array().unwrap()[..] else { panic!("{resized:#}") };
    assert!(
        one["frame"] == 4 && one["why"].as_str().unwrap().contains("64x40 pixels, frame 3 before it 64x48"),
        "{one:#}"
    );
    assert!(resized["frames"][4]["jod"]["picture"] == 10.0 && jod(&resized) < 10.0);
}

#[test]
fn pictures_too_small_to_be_seen_are_said() {
    let folder = tempfile::tempdir().expect("folder");
    for number in 1..=2 {
        write_picture(&folder.path().join(format!("r.{number}.exr")), &Image::filled(3, 3, 20, 0.5));
    }
    let found = measured(folder.path(), "r.#.exr", &["--frames", "1-2"]);
    assert!(found["jod"].is_null() && found["temporal"] == 0.0, "{found:#}");
    assert!(found["left_out"][1]["why"].as_str().unwrap().contains("20x3 pixels, fewer than 4"), "{found:#}");
}

#[test]
fn without_jod_the_rest_is_the_same() {
    let folder = shot();
    let (with, without) = (
        measured(folder.path(), "x.#.exr", &["--frames", "1-6"]),
        measured(folder.path(), "x.#.exr", &["--frames", "1-6", "--no-jod"]),
    );
    assert!(with["jod"].is_number() && without["jod"].is_null(), "{} {}", with["jod"], without["jod"]);
    assert_eq!((&with["rel_l2"], &with["temporal"]), (&without["rel_l2"], &without["temporal"]));
    assert_eq!(without["left_out"].as_array().map(Vec::len), Some(0), "what nobody asked for is not left out");
}

#[test]
fn a_plot_has_a_point_for_every_frame() {
    let shot = shot();
    let folder = shot.path();
    let arguments = ["--frames", "1-6", "--denoised", "z.#.exr", "--plot", "plot.svg"];
    let found = measured(folder, "x.#.exr", &arguments);
    let text = std::fs::read_to_string(folder.join("plot.svg")).expect("a plot");
    assert_well_formed(&text);
    // Six of relL2 and of either JOD, five steps.
    assert_eq!(text.matches("<circle").count(), 6 + 5 + 6 + 6);
    let mean = found["denoised"]["rel_l2_ratio"].as_f64().unwrap();
    for words in ["Error and flicker of frames 1-6", "temporal error", "JOD", &format!("of the shot: {mean:.3}")] {
        assert!(text.contains(words), "'{words}' in {text}");
    }
    let names: Vec<_> = std::fs::read_dir(folder).expect("folder").map(|entry| entry.unwrap().file_name()).collect();
    assert_eq!(names.len(), 3 * COUNT as usize + 1, "nothing but the plot: {names:?}");
}

/// Every element is closed, in order, and nothing else has a bracket.
fn assert_well_formed(text: &str) {
    let mut open = Vec::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('<') {
        assert!(!before.contains('>'), "{before}");
        let (tag, behind) = after.split_once('>').expect("the end of a tag");
        assert_eq!(tag.matches('"').count() % 2, 0, "{tag}");
        match tag.strip_prefix('/') {
            Some(name) => assert_eq!(open.pop(), Some(name)),
            None if tag.ends_with('/') => {}
            None => open.push(tag.split(' ').next().unwrap_or("")),
        }
        rest = behind;
    }
    assert!(open.is_empty() && rest.trim().is_empty(), "{open:?} {rest}");
}

#[test]
fn what_cannot_be_drawn_or_shown_is_refused() {
    let shot = shot();
    let folder = shot.path();
    let with = |more: &[&str]| evaluate(folder, &[&["x.#.exr", "--reference", "r.#.exr"], more].concat());
    let denoised = ["--denoised", "z.#.exr", "--plot", "p.svg"];
    let single = with(&[&denoised[..], &["--frames", "3"]].concat());
    assert_fails(&single, 2, &["--plot: expected at least 2 frames, found 3", "advice: "]);
    assert_fails(&with(&["--frames", "1-2", "--plot", "p.svg"]), 2, &["--denoised"]);
    assert_fails(&with(&denoised), 2, &["--frames"]);
    assert_fails(&with(&["--fps", "24"]), 2, &["--frames"]);
    for rate in ["0", "-1", "nan", "241", "many"] {
        assert_fails(&with(&["--frames", "1-2", &format!("--fps={rate}")]), 2, &["above 0, at most 240"]);
    }
    let over = with(&["--denoised", "z.#.exr", "--frames", "1-2", "--plot", "z.2.exr"]);
    assert_fails(&over, 4, &["z.2.exr", "an output that is no input"]);
    assert!(!folder.join("p.svg").exists());
}
