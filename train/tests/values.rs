//! Pixel values that people complain about, each in a frame whose denoiser takes texture away that the halves share: what
//! can be corrected is corrected, and nothing is worse than the denoiser's.

use sspc_core::rng::Rng;
use sspc_frames::read_picture;
use sspc_image::{Image, box_mean};
use sspc_testkit::exr_parts::write_layers;
use std::path::Path;
use std::process::{Command, Stdio};

const SIZE: (usize, usize) = (96, 128);
/// Samples of a half.
const SAMPLES: usize = 8;

/// A picture with its features, whole and in noisy halves.
struct Scene {
    clean: Image,
    halves: [Half; 2],
    denoised: Image,
}

struct Half {
    radiance: Image,
    denoised: Image,
    albedo: Image,
    normal: Image,
}

/// An image `[3, H, W]` of one function of channel and pixel.
fn image(value: impl FnMut(usize, usize, usize) -> f32) -> Image {
    Image::from_fn(3, SIZE.0, SIZE.1, value)
}

fn albedo(c: usize, y: usize, x: usize) -> f32 {
    let checker = ((x / 8 + y / 8) % 2) as f32;
    [0.2 + 0.6 * checker, 0.5 - 0.3 * checker, 0.3 + 0.2 * (x as f32 / 5.0).sin()][c]
}

/// Distance from the middle, in pixels, squared.
fn from_middle(y: usize, x: usize) -> f32 {
    (x as f32 - 64.0).powi(2) + (y as f32 - 48.0).powi(2)
}

/// Light on a checker, or what `change` makes of it.
fn clean(change: impl Fn(&Image, usize, usize, usize) -> f32) -> Image {
    let lit = image(|c, y, x| albedo(c, y, x) * (0.4 + 0.6 * (-from_middle(y, x) / 2560.0).exp()));
    image(|c, y, x| change(&lit, c, y, x))
}

/// Noise of `SAMPLES` exponential samples a pixel.
fn noisy(clean: &Image, seed: u64) -> Image {
    let rng = &mut Rng::new(seed);
    image(|c, y, x| {
        let sum: f32 = (0..SAMPLES).map(|_| -(1.0 - rng.uniform()).ln()).sum();
        clean.at(c, y, x) * sum / SAMPLES as f32
    })
}

fn scene(clean: Image) -> Scene {
    let radiance = [1, 2].map(|seed| noisy(&clean, seed));
    let denoised = box_mean(&Image::mean_of(&radiance[0], &radiance[1]), 2);
    let halves = radiance.map(|radiance| Half {
        denoised: box_mean(&radiance, 2),
        albedo: image(albedo),
        normal: image(|c, y, x| [x as f32 / 128.0 - 0.5, y as f32 / 96.0 - 0.5, 1.0][c] / 1.2),
        radiance,
    });
    Scene { clean, halves, denoised }
}

/// What became of a scene.
struct Outcome {
    picture: Image,
    report: serde_json::Value,
    /// Mean square error over the pixels that the case is about, corrected over denoised.
    ratio: f64,
}

impl Scene {
    fn corrected(&self, counts: impl Fn(usize, usize) -> bool) -> Outcome {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = |name: &str| folder.path().join(name);
        for (name, half) in ["a.exr", "b.exr"].iter().zip(&self.halves) {
            let Half { radiance, denoised, albedo, normal } = half;
            let layers = [("", "RGB", radiance), ("denoised", "RGB", denoised), ("albedo", "RGB", albedo)];
            write_layers(&path(name), &[&layers[..], &[("N", "XYZ", normal)]].concat());
        }
        write_layers(&path("denoised.exr"), &[("", "RGB", &self.denoised)]);
        let output = Command::new(env!("CARGO_BIN_EXE_sspc-train"))
            .stdin(Stdio::null())
            .args([
                "fit",
                "a.exr",
                "b.exr",
                "--denoised",
                "denoised.exr",
                "--preset",
                "fast",
                "--steps",
                "60",
                "-o",
                "out",
            ])
            .current_dir(folder.path())
            .output()
            .expect("sspc-train starts");
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let text = std::fs::read_to_string(path("out/report.json")).expect("a report");
        let picture = read_picture(Path::new(&path("out/corrected.exr")), None).expect("a picture");
        let ratio = self.error(&picture, &counts) / self.error(&self.denoised, &counts);
        Outcome { picture, report: serde_json::from_str(&text).expect("JSON"), ratio }
    }

    fn error(&self, picture: &Image, counts: &impl Fn(usize, usize) -> bool) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for (y, x) in (0..SIZE.0).flat_map(|y| (0..SIZE.1).map(move |x| (y, x))).filter(|&(y, x)| counts(y, x)) {
            let off = |c| f64::from(picture.at(c, y, x) - self.clean.at(c, y, x)).powi(2);
            let off: f64 = (0..3).map(off).sum();
            if off.is_finite() {
                (sum, count) = (sum + off, count + 1);
            }
        }
        sum / f64::from(count)
    }
}

impl Outcome {
    /// The denoiser loses most of the checker; a correction that sees albedo brings it back.
    fn assert_corrected(&self, most: f64) {
        assert!(self.report["fallback"].is_null(), "{}", self.report["fallback"]);
        assert!(self.ratio < most, "{} of the denoiser's error", self.ratio);
    }
}

fn everywhere(_: usize, _: usize) -> bool {
    true
}

#[test]
fn colour_out_of_gamut_is_no_worse_than_the_denoisers() {
    let negative = |y: usize, x: usize| (20..70).contains(&y) && (30..90).contains(&x);
    let scene = scene(clean(|lit, c, y, x| match c {
        0 if negative(y, x) => -0.35 * lit.at(2, y, x),
        _ => lit.at(c, y, x),
    }));
    let outcome = scene.corrected(everywhere);
    outcome.assert_corrected(0.7);
    assert!(outcome.report["found"]["negative_values"].as_u64() > Some(1000), "{}", outcome.report["found"]);
    let there = scene.error(&outcome.picture, &negative) / scene.error(&scene.denoised, &negative);
    assert!(there < 1.0, "{there} of the denoiser's error where it is negative");
    let mean = |image: &Image| {
        let of = |y: usize| (30..90).map(move |x| (y, x));
        (20..70).flat_map(of).map(|(y, x)| f64::from(image.at(0, y, x))).sum::<f64>() / 3000.0
    };
    let [truth, denoised, corrected] = [&scene.clean, &scene.denoised, &outcome.picture].map(mean);
    assert!((corrected - truth).abs() < (denoised - truth).abs() + 0.01, "{corrected}, {denoised}, truth {truth}");
}

#[test]
fn a_lamp_beyond_half_floats_spoils_nothing_around_it() {
    let lamp = |y: usize, x: usize| (40..46).contains(&y) && (60..70).contains(&x);
    let mut scene = scene(clean(|lit, c, y, x| if lamp(y, x) { 2e5 } else { lit.at(c, y, x) }));
    let [a, b] = &mut scene.halves;
    for image in [&mut a.radiance, &mut a.denoised, &mut b.radiance, &mut b.denoised, &mut scene.denoised] {
        image.data_mut().iter_mut().filter(|value| **value > 65504.0).for_each(|value| *value = f32::INFINITY);
    }
    let far = |y: usize, x: usize| !((34..52).contains(&y) && (54..76).contains(&x));
    let outcome = scene.corrected(far);
    outcome.assert_corrected(0.7);
    assert!(outcome.picture.data().iter().all(|value| value.is_finite()));
}

#[test]
fn an_albedo_of_96_on_metal_is_a_feature_like_others() {
    let mut scene = scene(clean(|lit, c, y, x| lit.at(c, y, x)));
    for (seed, half) in [20, 21].into_iter().zip(&mut scene.halves) {
        let rng = &mut Rng::new(seed);
        let metal = |y: usize, x: usize| (30..60).contains(&y) && (40..80).contains(&x);
        half.albedo = image(|c, y, x| if metal(y, x) { 96.0 * rng.uniform().powi(8) } else { albedo(c, y, x) });
    }
    scene.corrected(everywhere).assert_corrected(0.8);
}

#[test]
fn a_sky_without_features_is_corrected_too() {
    let mut scene = scene(clean(|lit, c, y, x| lit.at(c, y, x)));
    for half in &mut scene.halves {
        let sky = |of: &Image, value: f32| image(|c, y, x| if y < 40 { value } else { of.at(c, y, x) });
        (half.albedo, half.normal) = (sky(&half.albedo, f32::INFINITY), sky(&half.normal, f32::NAN));
    }
    let outcome = scene.corrected(|y, _| y < 40);
    outcome.assert_corrected(0.95);
    assert_eq!(outcome.report["found"]["missing_pixels"], 0);
    assert_eq!(outcome.report["found"]["pixels_without_feature"], 40 * 128);
}

#[test]
fn what_the_denoiser_spoilt_is_filled() {
    let mut scene = scene(clean(|lit, c, y, x| lit.at(c, y, x)));
    for (c, y, x) in (0..3).flat_map(|c| (10..20).flat_map(move |y| (10..20).map(move |x| (c, y, x)))) {
        scene.denoised.set(c, y, x, f32::NAN);
    }
    scene.denoised.set(0, 50, 50, f32::NEG_INFINITY);
    let outcome = scene.corrected(everywhere);
    outcome.assert_corrected(0.7);
    assert!(outcome.picture.data().iter().all(|value| value.is_finite()));
    assert_eq!(outcome.report["found"]["missing_pixels"], 101);
}

#[test]
fn the_ends_of_f32_are_ordinary_values() {
    let mut scene = scene(clean(|lit, c, y, x| lit.at(c, y, x)));
    for half in &mut scene.halves {
        half.radiance.set(0, 5, 5, 3.4e38);
        half.radiance.set(1, 6, 6, -3.4e38);
        half.radiance.set(2, 7, 7, 1e-45);
        half.denoised.set(0, 5, 5, 3e38);
    }
    let outcome = scene.corrected(|y, x| y > 20 || x > 20);
    outcome.assert_corrected(0.7);
    assert!(outcome.picture.data().iter().all(|value| value.is_finite()));
}
