//! `sspc-infer run --passes` as a person runs it: passes come back corrected, and add up to the picture.

use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_image::Image;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model, write_network};
use sspc_testkit::exr_parts::{Part, write_parts};
use sspc_testkit::lit_frame::{LitFrame, read_layer};
use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Sums of single floats, taken in double precision: half an ulp of the largest.
const OF_FLOATS: f64 = 1.2e-7;
/// Of half floats: half an ulp of the largest, which is at most 2^-11 of it.
const OF_HALVES: f64 = 4.9e-4;

fn folder_of(frame: &LitFrame) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("folder");
    frame.write(folder.path());
    let contract = Contract::new(Form::Gated);
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    let model = write_network(&Model::new(contract, weights).expect("a model"));
    fs::write(folder.path().join("model.onnx"), model).expect("model");
    folder
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    run_on(folder, &["a.exr", "b.exr"], arguments)
}

fn run_on(folder: &Path, halves: &[&str], arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_sspc-infer"));
    command.current_dir(folder).args(["run", "--model", "model.onnx"]).args(halves);
    command.args(["-o", "out.exr", "--json"]).args(arguments).output().expect("sspc-infer runs")
}

fn works(folder: &Path, arguments: &[&str]) {
    let output = run(folder, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
}

fn fails(folder: &Path, arguments: &[&str], words: &[&str]) {
    let output = run(folder, arguments);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{said}");
    words.iter().for_each(|word| assert!(said.contains(word), "{word} in: {said}"));
    assert!(!folder.join("out.exr").exists(), "nothing is written");
}

const LIGHTS: &[&str] = &["RGBA_key", "RGBA_fill", "RGBA_default"];

#[test]
fn light_groups_add_up_to_the_corrected_picture() {
    let mut frame = LitFrame::new(24, 40, LIGHTS);
    for (half, tolerance) in
        [([false; 2], OF_FLOATS), ([true; 2], OF_HALVES), ([false, true], OF_FLOATS), ([true, false], OF_HALVES)]
    {
        frame.half = half;
        let folder = folder_of(&frame);
        works(folder.path(), &["--passes", "auto"]);
        let error = frame.sum_error(&folder.path().join("out.exr"));
        assert!(error <= tolerance, "{half:?}: {error}");
        // Every pass is corrected: less noisy than it came.
        for layer in LIGHTS {
            let [noisy, made] =
                ["a.exr", "out.exr"].map(|file| roughness(&read_layer(&folder.path().join(file), layer, "RGB")));
            assert!(made < 0.5 * noisy, "{layer}: {made} of {noisy}");
        }
        let report = fs::read_to_string(folder.path().join("out.json")).expect("report");
        for word in ["light groups", "RGBA_fill", "largest_error", "noisy_difference"] {
            assert!(report.contains(word), "{word} in {report}");
        }
    }
}

#[test]
fn one_file_may_hold_the_passes_of_both_halves() {
    let frame = LitFrame::new(24, 40, LIGHTS);
    let folder = folder_of(&frame);
    works(folder.path(), &["--passes", "auto"]);
    let at = |file: &str| folder.path().join(file);
    let corrected = |layer: &str| read_layer(&at("out.exr"), layer, "RGB");
    let expected: Vec<Image> = [""].iter().chain(LIGHTS).map(|layer| corrected(layer)).collect();
    let names = ["", "denoised"].iter().chain(LIGHTS).copied();
    let marked = names.flat_map(|layer| [("a", layer), ("b", layer)]).map(|(half, layer)| {
        let image = read_layer(&at(&format!("{half}.exr")), layer, "RGB");
        (format!("{}_{half}", if layer.is_empty() { "RGBA" } else { layer }), image)
    });
    let marked: Vec<(String, Image)> = marked.collect();
    let layers: Vec<(&str, &str, &Image)> = marked.iter().map(|(name, image)| (name.as_str(), "RGB", image)).collect();
    sspc_testkit::exr_parts::write_layers(&at("both.exr"), &layers);
    let output = run_on(folder.path(), &["both.exr"], &["--passes", "auto"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    // Where the file has no layer of both halves together, new ones.
    for (layer, expected) in [""].iter().chain(LIGHTS).zip(&expected) {
        assert!(corrected(layer) == *expected, "{layer} is as from two files");
    }
    for (layer, _, given) in &layers {
        assert!(corrected(layer) == **given, "{layer} stays");
    }
    fs::remove_file(at("out.exr")).expect("the output");
    // A pass of half a alone.
    let lacking: Vec<_> = layers.iter().filter(|layer| layer.0 != "RGBA_fill_b").copied().collect();
    sspc_testkit::exr_parts::write_layers(&at("both.exr"), &lacking);
    let output = run_on(folder.path(), &["both.exr"], &["--passes", "auto"]);
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("RGBA_fill_a") && said.contains("as in half a"), "{said}");
}

/// Mean squared difference between neighbours.
fn roughness(image: &Image) -> f64 {
    let squares = image.data().windows(2).map(|pair| f64::from(pair[1] - pair[0]).powi(2));
    squares.sum::<f64>() / image.data().len() as f64
}

#[test]
fn sums_hold_wherever_the_picture_comes_from() {
    let mut frame = LitFrame::new(33, 50, LIGHTS);
    frame.missing = Some((7, 9));
    frame.still_from = 32;
    let folder = folder_of(&frame);
    for strength in ["0", "0.5", "1"] {
        works(folder.path(), &["--passes", "auto", "--strength", strength]);
        let error = frame.sum_error(&folder.path().join("out.exr"));
        assert!(error <= OF_FLOATS, "strength {strength}: {error}");
    }
}

#[test]
fn lobes_of_cycles_come_back_divided_by_their_colour() {
    let layers = ["ViewLayer.Diffuse Direct", "ViewLayer.Diffuse Indirect", "ViewLayer.Emission"];
    let mut frame = LitFrame::new(24, 40, &layers);
    frame.picture = "ViewLayer.Combined".into();
    for light in &mut frame.lights[..2] {
        light.colour = Some("ViewLayer.Diffuse Color".into());
    }
    for (half, tolerance) in [([false; 2], 2.0 * OF_FLOATS), ([true; 2], 2.0 * OF_HALVES)] {
        frame.half = half;
        let folder = folder_of(&frame);
        works(folder.path(), &["--passes", "auto"]);
        let error = frame.sum_error(&folder.path().join("out.exr"));
        assert!(error <= tolerance, "{half:?}: {error}");
    }
}

#[test]
fn sets_that_do_not_add_up_are_refused_with_the_reason() {
    let frame = LitFrame::new(24, 40, &["key", "fill", "rim"]);
    let folder = folder_of(&frame);
    fails(folder.path(), &["--passes", "key,rim"], &["fill is missing", "%"]);
    fails(folder.path(), &["--passes", "auto"], &["light groups or lobes", "key"]);
    fails(folder.path(), &["--passes", "key,fill,rom"], &["'rom'"]);
    let mut twice = LitFrame::new(24, 40, &["RGBA_key", "RGBA_fill"]);
    twice.write(folder.path());
    for half in ["a.exr", "b.exr"] {
        // The key light once more, under another name, is in no sum.
        let path = folder.path().join(half);
        let [key, fill, picture] = ["RGBA_key", "RGBA_fill", ""].map(|layer| read_layer(&path, layer, "RGB"));
        let layers = [
            ("", "RGB", &picture),
            ("denoised", "RGB", &picture),
            ("RGBA_key", "RGB", &key),
            ("RGBA_fill", "RGB", &fill),
            ("RGBA_all", "RGB", &key),
        ];
        sspc_testkit::exr_parts::write_layers(&path, &layers);
    }
    fails(folder.path(), &["--passes", "auto"], &["is counted twice"]);
    // Named one by one they are right.
    twice.missing = None;
    works(folder.path(), &["--passes", "RGBA_key,RGBA_fill"]);
}

#[test]
fn a_pass_of_one_half_or_of_another_size_is_named() {
    let frame = LitFrame::new(24, 40, LIGHTS);
    let folder = folder_of(&frame);
    let other = tempfile::tempdir().expect("folder");
    LitFrame::new(24, 40, &LIGHTS[..2]).write(other.path());
    fs::copy(other.path().join("b.exr"), folder.path().join("b.exr")).expect("half b");
    fails(folder.path(), &["--passes", "auto"], &["b.exr", "RGBA_default", "as in half a"]);
    for (half, seed) in [("a.exr", 1), ("b.exr", 2)] {
        let beauty = ["R", "G", "B", "denoised.R", "denoised.G", "denoised.B"];
        let parts = [
            Part { name: "beauty", channels: &beauty, ..Part::default() },
            Part { name: "RGBA_key", channels: &["R", "G", "B"], size: (5, 5), ..Part::default() },
            Part { name: "RGBA_fill", channels: &["R", "G", "B"], ..Part::default() },
        ];
        write_parts(&folder.path().join(half), seed, &parts);
    }
    fails(folder.path(), &["--passes", "RGBA_key.RGBA_key,*fill"], &["additive passes"]);
}

#[test]
fn negative_many_and_oddly_named_passes_are_ordinary() {
    let names: Vec<String> = (0..64).map(|k| format!("light {k}.v1.2 left")).collect();
    let mut frame = LitFrame::new(9, 11, &names.iter().map(String::as_str).collect::<Vec<_>>());
    frame.lights[5].level = -0.02;
    let folder = folder_of(&frame);
    works(folder.path(), &["--passes", "*", "--role", "denoised=denoised"]);
    assert!(frame.sum_error(&folder.path().join("out.exr")) <= OF_FLOATS);
}

#[test]
fn one_pixel_is_a_picture() {
    let frame = LitFrame::new(1, 1, LIGHTS);
    let folder = folder_of(&frame);
    works(folder.path(), &["--passes", "RGBA_*", "--alpha"]);
    assert!(frame.sum_error(&folder.path().join("out.exr")) <= OF_FLOATS);
}

#[test]
fn alpha_is_left_unless_it_is_asked_for() {
    let frame = LitFrame::new(24, 60, LIGHTS);
    let folder = folder_of(&frame);
    let alpha = |file: &str| read_layer(&folder.path().join(file), "", "A");
    works(folder.path(), &["--passes", "auto"]);
    assert_eq!(alpha("out.exr"), alpha("a.exr"));
    works(folder.path(), &["--passes", "auto", "--alpha"]);
    let (made, noisy) = (alpha("out.exr"), alpha("a.exr"));
    // The coverage of the hair falls evenly from left to right.
    let error = |image: &Image| {
        let truth = |x: usize| 1.0 - x as f32 / 60.0;
        (0..24 * 60).map(|i| (image.data()[i] - truth(i % 60)).powi(2)).sum::<f32>()
    };
    assert!(made.data().iter().all(|a| (0.0..=1.0).contains(a)));
    assert!(error(&made) < 0.3 * error(&noisy), "{} of {}", error(&made), error(&noisy));
    assert!(frame.sum_error(&folder.path().join("out.exr")) <= OF_FLOATS, "passes are of the picture as it is");
}

#[test]
fn threads_do_not_show() {
    let frame = LitFrame::new(70, 90, LIGHTS);
    let folder = folder_of(&frame);
    let bytes = ["1", "3"].map(|threads| {
        works(folder.path(), &["--passes", "auto", "--alpha", "--threads", threads]);
        fs::read(folder.path().join("out.exr")).expect("output")
    });
    assert!(bytes[0] == bytes[1], "other bytes with other threads");
}
