//! Metrics against values computed by hand, naive twins and, for ꟻLIP, another implementation.

use sspc_frames::preview::tone_map;
use sspc_frames::read_picture;
use sspc_image::{Image, Reference, display};
use sspc_metrics::displayed::Displayed;
use sspc_metrics::flip::flip_map;
use sspc_metrics::relative::rel_l2_map;
use sspc_metrics::{brightness, figures, rel_l2, rel_l2_gain, smape};
use std::path::PathBuf;

/// f64 sums of a few f32 values: only the inputs' own rounding remains.
const EXACT: f64 = 1e-7;
/// Windows are summed in f64 but stored as f32: 6e-8 of the squares, against the constant 9e-4 under the variances.
const STORED_AS_F32: f64 = 2e-4;
/// The other implementation computes in f32 throughout and rounds its tables to it.
const OTHER_IMPLEMENTATION: f64 = 2e-4;

fn plain(mean: Image) -> Reference {
    Reference { mean, halves: None }
}

fn assert_near(found: f64, expected: f64, tolerance: f64) {
    assert!((found - expected).abs() <= tolerance, "{found} instead of {expected}");
}

fn noise(channels: usize, height: usize, width: usize, seed: u32) -> Image {
    Image::from_fn(channels, height, width, |c, y, x| {
        let mut bits = u64::from(seed) << 48 ^ ((c * height + y) * width + x) as u64;
        for factor in [0xBF58_476D_1CE4_E5B9u64, 0x94D0_49BB_1331_11EB] {
            bits = (bits ^ (bits >> 30)).wrapping_mul(factor);
        }
        (bits >> 40) as f32 / (1 << 24) as f32
    })
}

#[test]
fn rel_l2_by_hand() {
    // One pixel: x = (1, 2, 3), r = (1, 1, 1), r̄ = 1: (0 + 1 + 4) / 3 / 1.01.
    let x = Image::from_planes(3, 1, 1, vec![1.0, 2.0, 3.0]);
    let measured = rel_l2(&x, &plain(Image::filled(3, 1, 1, 1.0)));
    assert_near(measured.value, 5.0 / 3.0 / 1.01, EXACT);
    assert_eq!((measured.pixels, measured.excluded), (1, 0));
    assert!(measured.standard_error.is_nan(), "one pixel has no spread");
    // Two pixels, black reference: 0.25 / 0.01 and 0: mean 12.5, standard error 12.5.
    let x = Image::from_planes(3, 1, 2, vec![0.5, 0.0, 0.5, 0.0, 0.5, 0.0]);
    let measured = rel_l2(&x, &plain(Image::zeros(3, 1, 2)));
    assert_near(measured.value, 12.5, EXACT);
    assert_near(measured.standard_error, 12.5, EXACT);
    assert_near(f64::from(rel_l2_map(&x, &Image::zeros(3, 1, 2)).at(0, 0, 0)), 25.0, 1e-5);
}

#[test]
fn the_references_own_noise_is_taken_out() {
    // r^a = 0.8, r^b = 1.2: r = 1, ((r^a - r^b)/2)² = 0.04. x = 1.5: (0.25 - 0.04) / 1.01.
    let [a, b] = [0.8, 1.2].map(|v| Image::filled(3, 2, 2, v));
    let reference = Reference { mean: Image::mean_of(&a, &b), halves: Some([a, b]) };
    assert_near(rel_l2(&Image::filled(3, 2, 2, 1.5), &reference).value, 0.21 / 1.01, EXACT);
    assert_near(rel_l2(&reference.mean, &reference).value, -0.04 / 1.01, EXACT);
}

#[test]
fn a_noisy_reference_measures_what_a_clean_one_would() {
    let (height, width) = (64, 64);
    let truth = Image::filled(3, height, width, 0.5);
    let with_noise = |seed| {
        let noise = noise(3, height, width, seed);
        Image::from_fn(3, height, width, |c, y, x| truth.at(c, y, x) + 0.1 * (noise.at(c, y, x) - 0.5))
    };
    let (a, b) = (with_noise(1), with_noise(2));
    let reference = Reference { mean: Image::mean_of(&a, &b), halves: Some([a, b]) };
    let picture = Image::filled(3, height, width, 0.51);
    let clean = rel_l2(&picture, &plain(truth)).value;
    let corrected = rel_l2(&picture, &reference);
    let naive = rel_l2(&picture, &plain(reference.mean.clone())).value;
    assert!((corrected.value - clean).abs() < 4.0 * corrected.standard_error, "{corrected:?} against {clean}");
    assert!(naive > 2.0 * clean, "without it the reference's noise is counted: {naive} against {clean}");
}

/// Noise of the reference in its own denominator makes a picture below the truth look better; across halves it does not.
#[test]
fn across_the_references_halves_the_darker_picture_is_not_preferred() {
    let (height, width) = (96, 96);
    let with_noise = |seed| {
        let noise = noise(1, height, width, seed);
        Image::from_fn(3, height, width, |_, y, x| 0.3 + 0.5 * (noise.at(0, y, x) - 0.5))
    };
    let (a, b) = (with_noise(1), with_noise(2));
    // The error of 0.03 at every pixel, under the denominator of one half.
    let weights = |half: &Image| half.plane(0).iter().map(|r| 1.0 / (f64::from(*r).powi(2) + 0.01)).sum::<f64>();
    let expected = -0.03f64.powi(2) * 0.5 * (weights(&a) + weights(&b)) / (height * width) as f64;
    let reference = Reference { mean: Image::mean_of(&a, &b), halves: Some([a, b]) };
    let (truth, darker) = (Image::filled(3, height, width, 0.3), Image::filled(3, height, width, 0.27));
    assert!(rel_l2(&darker, &reference).value < rel_l2(&truth, &reference).value, "the bias that this figure is for");
    let gain = rel_l2_gain(&darker, &truth, &reference).expect("halves");
    assert!((gain.value - expected).abs() < 3.0 * gain.standard_error, "{gain:?}, expected {expected}");
    assert!(gain.value < -2.0 * gain.standard_error, "{gain:?}");
    assert_eq!(rel_l2_gain(&truth, &truth, &reference).expect("halves").value, 0.0);
    assert!(rel_l2_gain(&darker, &truth, &plain(truth.clone())).is_none(), "without halves");
}

/// Without noise the gain is the difference of relL2.
#[test]
fn a_gain_by_hand() {
    let pixel = |values: [f32; 3]| Image::from_planes(3, 1, 1, values.to_vec());
    let r = pixel([1.0, 2.0, 3.0]);
    let reference = Reference { mean: r.clone(), halves: Some([r.clone(), r]) };
    let gain = rel_l2_gain(&pixel([1.0, 2.0, 4.0]), &pixel([3.0, 2.0, 3.0]), &reference).expect("halves");
    assert_near(gain.value, (4.0 - 1.0) / 3.0 / 4.01, EXACT);
    assert_eq!((gain.pixels, gain.excluded), (1, 0));
    let nothing = rel_l2_gain(&pixel([f32::NAN; 3]), &pixel([1.0; 3]), &reference).expect("halves");
    assert_eq!((nothing.pixels, nothing.excluded), (0, 1));
}

#[test]
fn missing_pixels_are_left_out_and_counted() {
    let mut x = Image::filled(3, 2, 2, 1.5);
    let mut r = Image::filled(3, 2, 2, 1.0);
    x.set(1, 0, 0, f32::NAN);
    r.set(2, 1, 1, f32::INFINITY);
    let reference = plain(r);
    let all = figures(&x, &reference, 1.0);
    assert_eq!((all.pixels, all.excluded), (2, 2));
    assert_near(all.rel_l2, 0.25 / 1.01, EXACT);
    assert_near(all.smape, 0.4, EXACT);
    assert!(all.psnr.is_infinite() && all.ssim > 0.999 && all.flip == 0.0, "both are displayed as white: {all:?}");
    let nothing = figures(&Image::filled(3, 1, 1, f32::NAN), &plain(Image::zeros(3, 1, 1)), 1.0);
    assert_eq!((nothing.pixels, nothing.excluded), (0, 1));
    assert!(nothing.rel_l2.is_nan() && nothing.ssim.is_nan() && nothing.flip.is_nan());
}

#[test]
fn smape_by_hand() {
    let x = Image::from_planes(1, 1, 3, vec![0.0, 1.0, 3.0]);
    let r = Image::from_planes(1, 1, 3, vec![0.0, 0.0, 1.0]);
    // 0, 2 and 2·2/4.
    assert_near(smape(&x, &plain(r)).value, 1.0, EXACT);
}

#[test]
fn brightness_by_hand() {
    let r = Image::from_planes(1, 1, 3, vec![1.0, 3.0, 100.0]);
    let x = Image::from_planes(1, 1, 3, vec![2.0, 1.0, f32::NAN]);
    assert_near(brightness(&x, &r), 0.75, EXACT);
    assert!(brightness(&x, &Image::zeros(1, 1, 3)).is_nan(), "against black");
}

#[test]
fn psnr_by_hand() {
    let (x, r) = (Image::filled(3, 1, 2, 0.5), Image::filled(3, 1, 2, 0.25));
    let difference = f64::from(display(0.5, 1.0) - display(0.25, 1.0));
    assert_near(Displayed::new(&x, &r, 1.0).psnr(), -20.0 * difference.log10(), EXACT);
    // 18 % grey at exposure 2 is 36 % grey.
    assert_eq!(
        Displayed::new(&Image::filled(3, 1, 1, 0.18), &r.crop(0, 0, 1, 1), 2.0).picture.at(0, 0, 0),
        display(0.36, 1.0)
    );
}

/// SSIM of one pixel straight from Wang et al. 2004.
fn naive_ssim(x: &Image, r: &Image, row: usize, column: usize) -> f64 {
    let luma = |image: &Image, y: i64, x: i64| {
        let y = y.clamp(0, image.height() as i64 - 1) as usize;
        let x = x.clamp(0, image.width() as i64 - 1) as usize;
        let [red, green, blue] = [0, 1, 2].map(|c| f64::from(image.at(c, y, x)));
        0.2126 * red + 0.7152 * green + 0.0722 * blue
    };
    let mut taps = Vec::new();
    for dy in -5i64..=5 {
        for dx in -5i64..=5 {
            let weight = (-((dx * dx + dy * dy) as f64) / (2.0 * 1.5 * 1.5)).exp();
            let at = (row as i64 + dy, column as i64 + dx);
            taps.push((weight, luma(x, at.0, at.1), luma(r, at.0, at.1)));
        }
    }
    let total: f64 = taps.iter().map(|t| t.0).sum();
    let mean = |f: &dyn Fn(f64, f64) -> f64| taps.iter().map(|&(w, x, r)| w * f(x, r)).sum::<f64>() / total;
    let (mx, mr) = (mean(&|x, _| x), mean(&|_, r| r));
    let (vx, vr) = (mean(&|x, _| (x - mx).powi(2)), mean(&|_, r| (r - mr).powi(2)));
    let covariance = mean(&|x, r| (x - mx) * (r - mr));
    (2.0 * mx * mr + 1e-4) * (2.0 * covariance + 9e-4) / ((mx * mx + mr * mr + 1e-4) * (vx + vr + 9e-4))
}

#[test]
fn ssim_is_its_definition_at_any_size() {
    for (height, width) in [(1, 1), (1, 7), (9, 1), (3, 5), (17, 13)] {
        let (x, r) = (noise(3, height, width, 3), noise(3, height, width, 4));
        let displayed = Displayed::new(&x, &r, 1.0);
        let mut sum = 0.0;
        for y in 0..height {
            for x in 0..width {
                sum += naive_ssim(&displayed.picture, &displayed.reference, y, x);
            }
        }
        assert_near(displayed.ssim(), sum / (height * width) as f64, STORED_AS_F32);
    }
}

fn sample(path: &str, exposure: f32) -> Image {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/data").join(path);
    let bytes = tone_map(&read_picture(&path, None).expect("sample"), exposure);
    Image::from_fn(3, bytes.height, bytes.width, |c, y, x| f32::from(bytes.data[3 * (y * bytes.width + x) + c]) / 255.0)
}

#[test]
fn flip_agrees_with_another_implementation() {
    // The crate nv-flip 0.1.2 (the authors' C++) on these pictures in 8 bits at 67 pixels per degree: the mean, and
    // the first pixel of the top row, which sees the border.
    for (reference, picture, mean, first) in [
        ("sample/ref.exr", "sample/a.exr", 0.072_679_577, 0.334_706_46),
        ("sample/ref.exr", "sample/denoised.exr", 0.040_461_834, 0.065_439_52),
        ("blender/denoised.exr", "blender/a.exr", 0.102_877_393, 0.086_812_08),
    ] {
        let map = flip_map(&sample(picture, 1.0), &sample(reference, 1.0), 67.0);
        let found = map.data.iter().map(|error| f64::from(*error)).sum::<f64>() / map.data.len() as f64;
        assert_near(found, mean, OTHER_IMPLEMENTATION);
        assert_near(f64::from(map.data[0]), first, OTHER_IMPLEMENTATION);
    }
}

#[test]
fn flip_is_zero_for_equal_and_largest_for_opposite_pictures() {
    for (height, width) in [(1, 1), (1, 6), (5, 3)] {
        let x = noise(3, height, width, 5);
        assert!(flip_map(&x, &x, 67.0).data.iter().all(|error| *error == 0.0));
    }
    let uniform = |rgb: [f32; 3]| Image::from_fn(3, 4, 4, |c, _, _| rgb[c]);
    let map = flip_map(&uniform([0.0, 1.0, 0.0]), &uniform([0.0, 0.0, 1.0]), 67.0);
    // Green against blue is the largest colour difference by construction.
    map.data.iter().for_each(|error| assert_near(f64::from(*error), 1.0, 1e-5));
}

#[test]
fn figures_do_not_depend_on_the_number_of_threads() {
    let (x, r) = (noise(3, 37, 41, 6), plain(noise(3, 37, 41, 7)));
    let with = |threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("pool");
        pool.install(|| figures(&x, &r, 0.7))
    };
    let one = with(1);
    assert_eq!(one, with(2));
    assert_eq!(one, with(5));
}

#[test]
#[should_panic(expected = "a picture of 3x2x2 against a reference of 3x2x3")]
fn shapes_that_differ_are_named() {
    rel_l2(&Image::zeros(3, 2, 2), &plain(Image::zeros(3, 2, 3)));
}
