//! Differences of y as files hold them: the usual ones, others that are found out, and what cannot be used.

use crate::{command, folder};
use sspc_core::rng::Rng;
use sspc_frames::read_picture;
use sspc_image::Image;
use sspc_onnx::load_model;
use sspc_testkit::exr_parts::{write_mixed, write_picture};
use std::path::Path;
use std::process::Output;

const HEIGHT: usize = 48;
const WIDTH: usize = 64;

/// Rough enough that a difference to another neighbour is another one.
fn truth(c: usize, y: usize, x: usize) -> f32 {
    1.0 + 0.6 * ((x as f32 + c as f32) * 1.1).sin() * (y as f32 * 1.3).cos()
}

/// The differences of one half: dx and dy, noise of their own included.
fn differences(seed: u64) -> [Image; 2] {
    let rng = &mut Rng::new(seed);
    [(0, 1), (1, 0)].map(|(down, right)| {
        Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| truth(c, y + down, x + right) - truth(c, y, x) + 0.05 * rng.normal())
    })
}

/// Writes half `a` or `b` with further layers.
fn write(folder: &Path, name: &str, layers: &[(&str, &Image)]) {
    let rng = &mut Rng::new(if name == "a" { 1 } else { 2 });
    let mut picture = |contrast: f32, noise: f32| {
        let value = |c, y, x| 1.0 + contrast * (truth(c, y, x) - 1.0);
        Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| (value(c, y, x) + noise * rng.normal()).max(0.0))
    };
    // The denoiser has lost a third of the contrast.
    let (noisy, denoised) = (picture(1.0, 0.2), picture(0.67, 0.02));
    let mut all = vec![("", "RGB", &noisy, false), ("denoised", "RGB", &denoised, false)];
    all.extend(layers.iter().map(|(layer, image)| (*layer, "RGB", *image, false)));
    write_mixed(&folder.join(format!("{name}.exr")), &all);
}

fn fit(folder: &Path, out: &str, arguments: &[&str]) -> Output {
    let mut command = command();
    command.current_dir(folder).args(["fit", "a.exr", "b.exr", "--preset", "fast", "--steps", "12", "-o", out]);
    command.args(arguments).output().expect("sspc-train starts")
}

const WITH: [&str; 2] = ["--set", "differences=1"];

fn picture(folder: &Path, out: &str) -> Image {
    read_picture(&folder.join(out).join("corrected.exr"), None).expect("a picture")
}

/// Fits with the differences of both halves as `change` makes them; what was said, and the picture.
fn fitted(change: impl Fn([Image; 2]) -> Vec<(&'static str, Image)>) -> (String, Image, f32) {
    let folder = folder();
    for (name, seed) in [("a", 5), ("b", 6)] {
        let layers = change(differences(seed));
        write(folder.path(), name, &layers.iter().map(|(layer, image)| (*layer, image)).collect::<Vec<_>>());
    }
    let output = fit(folder.path(), "out", &WITH);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{said}");
    let model = load_model(&folder.path().join("out/model.onnx")).expect("a model");
    (said, picture(folder.path(), "out"), model.contract.differences)
}

fn mapped(image: &Image, of: impl Fn(usize, usize, usize) -> f32) -> Image {
    Image::from_fn(3, image.height(), image.width(), of)
}

#[test]
fn differences_are_used_where_they_are_asked_for_and_by_what_they_are() {
    let (said, plain, strength) = fitted(|_| Vec::new());
    assert!(!said.contains("dx") && strength == 0.0, "{said}");
    let (said, usual, strength) = fitted(|[dx, dy]| vec![("dx", dx), ("dy", dy)]);
    assert!(!said.contains("note: dx") && strength == 1.0, "{said}");
    assert!(usual != plain, "they change the picture");
    let negated = |image: &Image| mapped(image, |c, y, x| -image.at(c, y, x));
    let (said, other, _) = fitted(|[dx, dy]| vec![("dx", negated(&dx)), ("dy", dy)]);
    assert!(said.contains("dx is this pixel less the one on the right: taken as such"), "{said}");
    assert_eq!(other, usual);
    let moved = |image: &Image| mapped(image, |c, y, x| image.at(c, y.saturating_sub(1), x));
    let (said, other, _) = fitted(|[dx, dy]| vec![("dx", dx), ("dy", moved(&dy))]);
    assert!(said.contains("dy is this pixel less the one above: taken as such"), "{said}");
    assert_eq!(other, usual);
    let (said, other, _) = fitted(|[dx, dy]| vec![("dx", dy), ("dy", dx)]);
    assert!(said.contains("dx is the pixel below less this one: taken as such"), "{said}");
    assert_eq!(other, usual);
    let (said, other, strength) = fitted(|[mut dx, dy]| {
        (0..3).for_each(|c| dx.set(c, 20, 30, f32::NAN));
        vec![("dx", dx), ("dy", dy)]
    });
    assert!(said.contains("6 values of dx and dy are NaN or infinite: the term is left out there"), "{said}");
    assert!(strength == 1.0 && other.data().iter().all(|v| v.is_finite()));
}

#[test]
fn what_is_not_a_frames_differences_is_said_and_changes_nothing() {
    let (_, plain, _) = fitted(|_| Vec::new());
    let of_noise = || {
        let rng = &mut Rng::new(77);
        [(); 2].map(|()| Image::from_fn(3, HEIGHT, WIDTH, |_, _, _| rng.normal()))
    };
    type Change = Box<dyn Fn([Image; 2]) -> Vec<(&'static str, Image)>>;
    let cases: [(&str, Change); 4] = [
        ("dx is there and dy is not", Box::new(|[dx, _]| vec![("dx", dx)])),
        ("dy is there and dx is not", Box::new(|[_, dy]| vec![("dy", dy)])),
        ("dx and dy are both differences along rows", Box::new(|[dx, _]| vec![("dx", dx.clone()), ("dy", dx)])),
        (
            "does not follow the differences of the picture",
            Box::new(move |_| {
                let [dx, dy] = of_noise();
                vec![("dx", dx), ("dy", dy)]
            }),
        ),
    ];
    for (expected, change) in cases {
        let (said, picture, strength) = fitted(change);
        assert!(said.contains(expected), "{expected}: {said}");
        assert!(strength == 0.0 && picture == plain, "{expected}");
    }
}

#[test]
fn one_half_alone_and_unasked_differences_are_said_and_change_nothing() {
    let folder = folder();
    let [dx, dy] = differences(5);
    write(folder.path(), "b", &[]);
    write(folder.path(), "a", &[]);
    assert!(fit(folder.path(), "plain", &[]).status.success());
    write(folder.path(), "a", &[("dx", &dx), ("dy", &dy)]);
    let output = fit(folder.path(), "alone", &WITH);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("horizontal differences: only half a"), "{said}");
    assert_eq!(picture(folder.path(), "alone"), picture(folder.path(), "plain"));
    let [dx_b, dy_b] = differences(6);
    write(folder.path(), "b", &[("dx", &dx_b), ("dy", &dy_b)]);
    // In both halves, and nobody asks: not a word.
    let output = fit(folder.path(), "unasked", &[]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success() && !said.contains("differences"), "{said}");
    assert_eq!(picture(folder.path(), "unasked"), picture(folder.path(), "plain"));
    // Named by role, and not asked for.
    let output = fit(folder.path(), "named", &["--role", "dx=dx"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("--set differences=1"), "{said}");
    assert_eq!(picture(folder.path(), "named"), picture(folder.path(), "plain"));
}

#[test]
fn differences_of_another_size_are_refused_with_both_sizes() {
    let folder = folder();
    let [dx, dy] = differences(5);
    write(folder.path(), "a", &[("dx", &dx), ("dy", &dy)]);
    write(folder.path(), "b", &[("dx", &dx), ("dy", &dy)]);
    write_picture(&folder.path().join("small.exr"), &Image::filled(3, 20, 30, 0.1));
    let output = fit(folder.path(), "out", &["--set", "differences=1", "--role", "dx-a=small.exr"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(3), "{said}");
    assert!(said.contains("30x20") && said.contains("64x48"), "{said}");
    assert!(!folder.path().join("out").exists());
}

#[test]
fn the_picture_graph_knows_no_differences_and_says_so() {
    let folder = folder();
    for (name, seed) in [("a", 5), ("b", 6)] {
        let [dx, dy] = differences(seed);
        write(folder.path(), name, &[("dx", &dx), ("dy", &dy)]);
    }
    assert!(fit(folder.path(), "out", &WITH).status.success());
    let export = |graph: &str| {
        let mut command = command();
        command.current_dir(folder.path()).args(["export", "out", "--graph", graph, "-o", "graph.onnx"]);
        command.output().expect("sspc-train starts")
    };
    assert!(export("network").status.success());
    std::fs::remove_file(folder.path().join("graph.onnx")).expect("the graph");
    let output = export("picture");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(3) && said.contains("differences of y"), "{said}");
    assert!(!folder.path().join("graph.onnx").exists());
}
