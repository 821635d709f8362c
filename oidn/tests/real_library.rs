//! The real library, of PyPI's pyoidn in the environment of the tests (`.ci/setup-python`), which `SSPC_PYTHON_VENV` names;
//! without it the tests say aloud that they are skipped.

use sspc_image::Image;
use sspc_oidn::search::{Surroundings, folders_of_python, libraries_in};
use sspc_oidn::{Mode, Oidn, OidnError, Picture, Quality, Rows, Run};
use std::path::PathBuf;

const RUN: Run = Run { quality: Quality::High, max_memory: 512, asked_to_stop: || false };

fn library() -> Option<PathBuf> {
    let python = std::env::var_os("SSPC_PYTHON_VENV").map(PathBuf::from);
    let environment = python.as_ref().and_then(|python| python.parent()?.parent());
    let found = environment.and_then(|folder| folders_of_python(folder).iter().find_map(|f| libraries_in(f).pop()));
    if found.is_none() {
        eprintln!("skipped: SSPC_PYTHON_VENV names no environment with pyoidn; .ci/setup-python makes one");
    }
    found
}

fn oidn(threads: usize) -> Option<Oidn> {
    library().map(|path| Oidn::open(&path, threads).unwrap_or_else(|error| panic!("{error}")))
}

/// A smooth picture and its noise, with features that show an edge.
struct Scene {
    truth: Image,
    noisy: Image,
    albedo: Image,
    normal: Image,
}

impl Scene {
    fn new(height: usize, width: usize) -> Self {
        let mut random = fastrand::Rng::with_seed(7);
        let side = |x: usize| if 3 * x > width { 1.0 } else { 0.25 };
        let truth =
            Image::from_fn(3, height, width, |c, y, x| side(x) * (0.5 + 0.1 * c as f32 + y as f32 / height as f32));
        let mut noisy = truth.clone();
        // Exponential noise, as rare paths give.
        noisy.data_mut().iter_mut().for_each(|value| *value *= -random.f32().max(1e-6).ln());
        let albedo = Image::from_fn(3, height, width, |_, _, x| side(x));
        let normal = Image::from_fn(3, height, width, |c, _, _| if c == 2 { 1.0 } else { 0.0 });
        Self { truth, noisy, albedo, normal }
    }

    fn picture(&self) -> Picture {
        self.with(&self.noisy)
    }

    fn with(&self, colour: &Image) -> Picture {
        Picture::of(&Rows { colour, albedo: Some(&self.albedo), normal: Some(&self.normal) })
    }
}

fn error(image: &Image, truth: &Image) -> f64 {
    let squares = image.data().iter().zip(truth.data()).map(|(a, b)| f64::from(a - b).powi(2));
    squares.sum::<f64>() / truth.data().len() as f64
}

fn one(oidn: &Oidn, picture: Picture, mode: Mode, run: &Run) -> Image {
    let height = oidn.denoise(picture, &[mode], run).unwrap_or_else(|error| panic!("{error}"));
    let picture = &height[0].picture;
    picture.rows(0..picture.height())
}

#[test]
fn every_mode_and_quality_denoises() {
    let Some(oidn) = oidn(2) else { return };
    assert!(oidn.version().major >= 2);
    let scene = Scene::new(67, 91);
    let noisy = error(&scene.noisy, &scene.truth);
    let mut pictures: Vec<Image> = Vec::new();
    for quality in Quality::ALL {
        let denoised = oidn.denoise(scene.picture(), &Mode::ALL, &Run { quality, ..RUN }).expect("denoised");
        assert_eq!(denoised.iter().map(|d| d.mode).collect::<Vec<_>>(), Mode::ALL);
        for made in denoised {
            let picture = made.picture.rows(0..67);
            assert!(error(&picture, &scene.truth) < 0.02 * noisy, "{} {quality}", made.mode);
            assert!(made.seconds > 0.0);
            pictures.push(picture);
        }
    }
    let differ = |a: usize, b: usize| pictures[a] != pictures[b];
    assert!(differ(0, 1) && differ(1, 2) && differ(0, 2), "modes of one quality give one picture");
    // The library has a larger network for `high` than for `balanced` with clean features only.
    assert!(differ(0, 6) && differ(1, 7) && differ(2, 8) && differ(4, 7), "fast and high give one picture");
}

#[test]
fn modes_do_not_disturb_each_other_and_threads_change_nothing() {
    let (Some(two), Some(one_thread)) = (oidn(2), oidn(1)) else { return };
    let scene = Scene::new(50, 70);
    let modes = [Mode::CleanAux, Mode::Aux, Mode::Colour];
    let together = two.denoise(scene.picture(), &modes, &RUN).expect("denoised");
    for made in &together {
        let alone = one(&one_thread, scene.picture(), made.mode, &RUN);
        assert!(alone == made.picture.rows(0..50), "{}", made.mode);
    }
}

#[test]
fn little_memory_gives_the_same_picture_but_for_tiles() {
    let Some(oidn) = oidn(2) else { return };
    let scene = Scene::new(600, 900);
    let whole = one(&oidn, scene.picture(), Mode::Aux, &RUN);
    let tiled = one(&oidn, scene.picture(), Mode::Aux, &Run { max_memory: 32, ..RUN });
    // Tiles overlap by what the network sees, and half floats round.
    let difference = error(&whole, &tiled).sqrt();
    assert!(difference < 2e-3, "{difference}");
}

#[test]
fn unusual_values_and_sizes_are_borne() {
    let Some(oidn) = oidn(2) else { return };
    let finite = |image: &Image| image.data().iter().all(|value| value.is_finite() && *value >= 0.0);
    for (height, width) in [(1, 1), (1, 40), (33, 1), (2, 3)] {
        for mode in Mode::ALL {
            let picture = one(&oidn, Scene::new(height, width).picture(), mode, &RUN);
            assert!(finite(&picture), "{mode} of {height}x{width}");
        }
    }
    let scene = Scene::new(40, 40);
    for value in [65504.0, 1e9, f32::MAX, -3.0] {
        let mut colour = scene.noisy.clone();
        (0..3).for_each(|c| colour.set(c, 20, 20, value));
        assert!(finite(&one(&oidn, scene.with(&colour), Mode::Aux, &RUN)), "{value}");
    }
    let black = Image::zeros(3, 40, 40);
    assert!(one(&oidn, scene.with(&black), Mode::Colour, &RUN) == black, "black is not black");
}

#[test]
fn missing_pixels_are_missing_again_and_darken_nothing() {
    let Some(oidn) = oidn(2) else { return };
    let scene = Scene::new(64, 64);
    let mut colour = scene.noisy.clone();
    for (y, x) in [(10, 10), (10, 11), (40, 50)] {
        (0..3).for_each(|c| colour.set(c, y, x, if x == 50 { f32::INFINITY } else { f32::NAN }));
    }
    let picture = one(&oidn, scene.with(&colour), Mode::Aux, &RUN);
    let missing: Vec<usize> = (0..64 * 64).filter(|&i| !picture.plane(0)[i].is_finite()).collect();
    assert_eq!(missing, [10 * 64 + 10, 10 * 64 + 11, 40 * 64 + 50]);
    let whole = one(&oidn, scene.picture(), Mode::Aux, &RUN);
    for (y, x) in [(10, 12), (9, 9), (41, 50)] {
        assert!((picture.at(1, y, x) / whole.at(1, y, x) - 1.0).abs() < 0.2, "beside a hole, at {y} {x}");
    }
    let nothing = Image::filled(3, 64, 64, f32::NAN);
    assert!(one(&oidn, scene.with(&nothing), Mode::Aux, &RUN).data().iter().all(|value| value.is_nan()));
}

#[test]
fn features_that_are_missing_leave_colour_to_guide() {
    let Some(oidn) = oidn(2) else { return };
    let scene = Scene::new(48, 48);
    let colour = one(&oidn, scene.picture(), Mode::Colour, &RUN);
    let nan = Image::filled(3, 48, 48, f32::NAN);
    let rows = [
        Rows { colour: &scene.noisy, albedo: None, normal: None },
        Rows { colour: &scene.noisy, albedo: None, normal: Some(&scene.normal) },
        Rows { colour: &scene.noisy, albedo: Some(&nan), normal: Some(&scene.normal) },
    ];
    for rows in rows {
        assert!(one(&oidn, Picture::of(&rows), Mode::Aux, &RUN) == colour);
        assert!(one(&oidn, Picture::of(&rows), Mode::CleanAux, &RUN) == colour);
    }
    let without_normal = Rows { colour: &scene.noisy, albedo: Some(&scene.albedo), normal: None };
    assert!(one(&oidn, Picture::of(&without_normal), Mode::Aux, &RUN) != colour);
}

#[test]
fn it_stops_when_it_is_asked_to() {
    let Some(oidn) = oidn(2) else { return };
    let stop = Run { asked_to_stop: || true, ..RUN };
    assert_eq!(oidn.denoise(Scene::new(64, 64).picture(), &[Mode::Aux], &stop).err(), Some(OidnError::Cancelled));
    // And goes on afterwards.
    assert!(oidn.denoise(Scene::new(64, 64).picture(), &[Mode::Aux], &RUN).is_ok());
}

#[test]
fn an_active_environment_of_python_is_enough() {
    let Some(library) = library() else { return };
    let environment = std::env::var_os("SSPC_PYTHON_VENV").map(PathBuf::from).expect("named");
    let virtual_env = environment.parent().and_then(|bin| bin.parent()).map(PathBuf::from);
    // Another one may lie on the loader's own path, which comes first.
    let surroundings = Surroundings { virtual_env, ..Surroundings::default() };
    let candidates = format!("{:?}", surroundings.candidates().expect("candidates"));
    assert!(candidates.contains(&*library.parent().expect("a folder").to_string_lossy()), "{candidates}");
    assert!(Oidn::find_in(&surroundings, 1).is_ok());
}
