//! The SIMD kernels against their naive f64 twins: every instruction set, odd sizes, all window
//! positions, bandwidths at both ends of their range.

use sspc_core::rng::Rng;
use sspc_image::Image;
use sspc_kernels::features::{ALBEDO, FEATURE_CHANNELS, FeatureSet, RADIANCE};
use sspc_kernels::gc::{self, Correction, JointCorrection, NoUpstream, ParameterPlanes, Taps, View};
use sspc_kernels::network::{self, Network, Shape};
use sspc_kernels::parameters::{self, BANDWIDTHS, CENTRE, Form, activation_f64};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_testkit::kernels::{Pass, activated, correct, correct_and_back};
use sspc_testkit::method;

/// f32 sums of 361 terms whose exponents carry the rounding of γ·d; relative to the size of the terms.
const FORWARD_TOLERANCE: f64 = 1e-5;
/// Relative to the largest gradient of the same parameter.
const GRADIENT_TOLERANCE: f64 = 1e-4;
/// Where weights nearly vanish, 1/Σw multiplies the rounding of u_i - g: gradients below this share
/// of |G| Σ|w u| / Σw² are differences of much larger terms, and the tolerance is taken of the share.
const GRADIENT_CONDITION: f64 = 3e-2;
/// Nine layers of up to 144 f32 products each.
const NETWORK_TOLERANCE: f64 = 1e-5;

/// Radiance over several decades, features in their natural ranges.
fn features(rng: &mut Rng, height: usize, width: usize) -> Image {
    Image::from_fn(FEATURE_CHANNELS, height, width, |c, _, _| match c {
        0..3 | 10..13 => 10f32.powf(3.0 * rng.uniform() - 2.0),
        7..10 => 2.0 * rng.uniform() - 1.0,
        _ => rng.uniform(),
    })
}

/// Outputs of a network, spread so that bandwidths cover their range.
fn outputs(rng: &mut Rng, form: Form, pixels: usize, spread: f32) -> Vec<f32> {
    (0..form.parameters() * pixels).map(|_| spread * rng.normal()).collect()
}

fn activated_f64(form: Form, raw: &[f32]) -> Vec<f64> {
    let pixels = raw.len() / form.parameters();
    raw.iter().enumerate().map(|(i, &o)| activation_f64(i / pixels, f64::from(o)).0).collect()
}

/// Largest difference, relative to `scale`.
fn worst(got: &[f32], truth: &[f64], scale: f64) -> f64 {
    let errors = got.iter().zip(truth).map(|(&g, t)| (f64::from(g) - t).abs() / scale);
    // NaN is the worst of all.
    errors.fold(0.0, |worst: f64, e| if e.is_nan() { f64::INFINITY } else { worst.max(e) })
}

struct Case {
    height: usize,
    width: usize,
    radius: usize,
    region: Region,
    form: Form,
    spread: f32,
    set: FeatureSet,
    missing: bool,
}

fn check(case: &Case, taps: &Taps, seed: u64) {
    let rng = &mut Rng::new(seed);
    let mut image = features(rng, case.height, case.width);
    for (c, used) in [(3..6, case.set.albedo), (7..10, case.set.normal), (6..7, case.set.visibility)] {
        c.filter(|_| !used).for_each(|c| image.plane_mut(c).fill(0.0));
    }
    let valid = Image::from_fn(1, case.height, case.width, |_, _, _| f32::from(rng.uniform() > 0.2));
    let windows = Windows::new(&image, case.missing.then_some(&valid), case.set, case.radius);
    let raw = outputs(rng, case.form, case.region.pixels(), case.spread);
    let upstream: Vec<f32> = (0..3 * case.region.pixels()).map(|_| rng.normal()).collect();
    let exact = activated_f64(case.form, &raw);
    let mut p = raw.clone();
    for isa in Isa::available() {
        p.copy_from_slice(&raw);
        parameters::activate(isa, case.form, &mut p);
        for (i, (&got, t)) in p.iter().zip(&exact).enumerate() {
            assert!(
                (f64::from(got) - t).abs() < FORWARD_TOLERANCE * t.abs().max(0.1),
                "{}: activation {i}: {got} is not {t}",
                isa.name()
            );
        }
    }
    // g_c is judged on the very f32 parameters it gets: γ·d near 15 multiplies their rounding.
    let exact: Vec<f64> = p.iter().map(|&v| f64::from(v)).collect();
    let (mut truth, mut truth_gradient) = (vec![0.0; 3 * case.region.pixels()], vec![0.0; raw.len()]);
    let mut magnitude = truth.clone();
    // Largest amplification of a rounding of g among the region's pixels.
    let mut amplified = 0.0f64;
    let pixels = case.region.pixels();
    for i in 0..pixels {
        let (y, x) = (i / case.region.width, i % case.region.width);
        let p: Vec<f64> = (0..case.form.parameters()).map(|c| exact[c * pixels + i]).collect();
        let g = std::array::from_fn(|k| f64::from(upstream[k * pixels + i]));
        let result = gc::oracle::pixel(&windows, taps, case.form, &p, case.region.top + y, case.region.left + x, g);
        for k in 0..3 {
            truth[k * pixels + i] = result.corrected[k];
            magnitude[k * pixels + i] = result.magnitude[k];
            amplified = amplified.max(g[k].abs() * result.magnitude[k] * result.inverse);
        }
        for c in 0..case.form.parameters() {
            truth_gradient[c * pixels + i] = result.gradient[c];
        }
    }
    for isa in Isa::available() {
        let out = correct(isa, case.form, &windows, taps, case.region, &p);
        for (i, (&got, t)) in out.iter().zip(&truth).enumerate() {
            let error = (f64::from(got) - t).abs() / magnitude[i].max(1e-20);
            assert!(error < FORWARD_TOLERANCE, "{}: μ̂ at {i}: {got} is not {t}", isa.name());
        }
        let (_, gradient) = correct_and_back(isa, case.form, &windows, taps, case.region, &p, &upstream);
        for c in 0..case.form.parameters() {
            let part = c * pixels..(c + 1) * pixels;
            let scale = truth_gradient[part.clone()].iter().fold(GRADIENT_CONDITION * amplified, |m, t| m.max(t.abs()));
            let error = worst(&gradient[part.clone()], &truth_gradient[part], scale.max(1e-20));
            assert!(error < GRADIENT_TOLERANCE, "{}: gradient of parameter {c}: {error:e}", isa.name());
        }
    }
}

#[test]
fn g_c_and_its_gradient_match_the_oracle() {
    let all = FeatureSet::ALL;
    let whole = |height, width| Region { top: 0, left: 0, height, width };
    let cases = [
        (1, 1, 9, whole(1, 1), 1.0, all, false),
        (1, 37, 9, whole(1, 37), 1.0, all, false),
        (41, 1, 9, whole(41, 1), 1.0, all, false),
        (13, 17, 9, whole(13, 17), 2.0, all, false),
        (5, 50, 3, Region { top: 1, left: 7, height: 3, width: 35 }, 1.0, all, true),
        (23, 19, 12, Region { top: 11, left: 2, height: 12, width: 17 }, 8.0, all, false),
        (11, 33, 5, whole(11, 33), 20.0, FeatureSet { visibility: false, ..all }, true),
        // Wider than what is worked on at a time.
        (4, 150, 6, whole(4, 150), 1.0, all, false),
        (9, 16, 2, whole(9, 16), 0.5, FeatureSet { albedo: false, normal: false, visibility: false }, false),
    ];
    for (i, (height, width, radius, region, spread, set, missing)) in cases.into_iter().enumerate() {
        for form in [Form::Paper, Form::Gated] {
            let case = Case { height, width, radius, region, form, spread, set, missing };
            check(&case, &Taps::square(radius), i as u64 + 1);
        }
    }
}

/// The oracle has the kernels' own floor of Σw, so this is by hand: around a missing centre Σw is that of 24 taps, and where that is
/// below 1e-5, g_c of a grey picture falls with it. The centre alone weighs 1e-4 at least, ten times the floor.
#[test]
fn the_sum_of_weights_has_its_floor_and_no_higher_one() {
    let (taps, region) = (Taps::square(2), Region { top: 2, left: 2, height: 1, width: 1 });
    let image = Image::from_fn(FEATURE_CHANNELS, 5, 5, |c, y, x| match c {
        RADIANCE..=2 => 1.0,
        ALBEDO => f32::from((y, x) != (2, 2)),
        _ => 0.0,
    });
    let missing_centre = Image::from_fn(1, 5, 5, |_, y, x| f32::from((y, x) != (2, 2)));
    let weights_of = |gamma: f32, tau: f32| {
        let mut parameters = vec![0.0; Form::Paper.parameters()];
        (parameters[BANDWIDTHS], parameters[CENTRE]) = (gamma, tau);
        parameters
    };
    for isa in Isa::available() {
        let g_c = |valid: Option<&Image>, parameters: &[f32]| {
            let windows = Windows::new(&image, valid, FeatureSet::ALL, 2);
            correct(isa, Form::Paper, &windows, &taps, region, parameters)[0]
        };
        // w = exp(-γ) of each tap.
        for (sum, expected) in [(1e-3f32, 1.0), (2e-5, 1.0), (5e-6, 0.5), (1e-7, 0.01)] {
            let g = g_c(Some(&missing_centre), &weights_of(-(sum / 24.0).ln(), 1.0));
            assert!((g / expected - 1.0).abs() < 1e-4, "{}: Σw = {sum}: {g}, not {expected}", isa.name());
        }
        let g = g_c(None, &weights_of(1e4, 1e-4));
        assert!((g - 1.0).abs() < 1e-6, "{}: the centre alone: {g}", isa.name());
    }
}

/// Fails when a tap whose opposite is no tap is forgotten, or its opposite taken for one.
#[test]
fn any_set_of_taps_will_do() {
    let region = Region { top: 2, left: 1, height: 7, width: 20 };
    let (set, form) = (FeatureSet::ALL, Form::Gated);
    let case = Case { height: 12, width: 23, radius: 4, region, form, spread: 1.0, set, missing: true };
    let offsets = [(0, 3), (0, -1), (0, 1), (-2, 1), (2, -1), (3, 3), (-1, -4), (4, 0)];
    check(&case, &Taps::from_offsets(offsets.to_vec()), 21);
    check(&case, &Taps::from_offsets(Vec::new()), 22);
}

/// Central differences of g_c's own f64 values: the truncation error of a step of 1e-6 is far below.
const DIFFERENCE_TOLERANCE: f64 = 1e-5;

#[test]
fn the_oracles_gradient_is_that_of_finite_differences() {
    let rng = &mut Rng::new(11);
    let image = features(rng, 9, 10);
    let windows = Windows::new(&image, None, FeatureSet::ALL, 3);
    let taps = Taps::square(3);
    for form in [Form::Paper, Form::Gated] {
        let raw = outputs(rng, form, 1, 1.0);
        let p = activated_f64(form, &raw);
        let upstream = [0.7, -1.3, 0.4];
        let value = |p: &[f64]| {
            let corrected = gc::oracle::pixel(&windows, &taps, form, p, 4, 0, upstream).corrected;
            (0..3).map(|k| upstream[k] * corrected[k]).sum::<f64>()
        };
        let gradient = gc::oracle::pixel(&windows, &taps, form, &p, 4, 0, upstream).gradient;
        for c in 0..form.parameters() {
            let step = 1e-6 * p[c].abs().max(1.0);
            let (mut up, mut down) = (p.clone(), p.clone());
            up[c] += step;
            down[c] -= step;
            let difference = (value(&up) - value(&down)) / (2.0 * step);
            let error = (gradient[c] - difference).abs() / difference.abs().max(1e-3);
            assert!(error < DIFFERENCE_TOLERANCE, "{form:?}, parameter {c}: {} is not {difference}", gradient[c]);
        }
        // And the activations'.
        for (c, &o) in raw.iter().enumerate() {
            let at = |o: f64| activation_f64(c, o).0;
            let (value, slope) = activation_f64(c, f64::from(o));
            let difference = (at(f64::from(o) + 1e-6) - at(f64::from(o) - 1e-6)) / 2e-6;
            assert!((slope - difference).abs() < DIFFERENCE_TOLERANCE * value.abs().max(1.0), "activation {c}");
        }
    }
}

#[test]
fn a_region_is_the_same_part_of_the_whole() {
    let rng = &mut Rng::new(5);
    let image = features(rng, 29, 90);
    let windows = Windows::new(&image, None, FeatureSet::ALL, 9);
    let taps = Taps::square(9);
    let whole = Region::whole(windows.height(), windows.width());
    let mut p = outputs(rng, Form::Paper, whole.pixels(), 1.0);
    let isa = Isa::best();
    parameters::activate(isa, Form::Paper, &mut p);
    let mut out = vec![0.0; 3 * whole.pixels()];
    let of = |region, parameters| Correction { windows: &windows, taps: &taps, region, parameters };
    of(whole, ParameterPlanes::of_region(Form::Paper, &p, &whole)).forward(isa, &mut out);
    let whole_image = Image::from_planes(3, 29, 90, out);
    for region in [
        Region { top: 3, left: 0, height: 5, width: 90 },
        Region { top: 0, left: 55, height: 29, width: 20 },
        Region { top: 28, left: 89, height: 1, width: 1 },
    ] {
        let mut part = vec![0.0; 3 * region.pixels()];
        let view = ParameterPlanes::of_region(Form::Paper, &p, &whole).offset_by(region.top, region.left);
        let gradient = &mut vec![0.0; 15 * region.pixels()];
        of(region, view).backward(isa, &mut NoUpstream, &mut part, gradient);
        let expected = whole_image.crop(region.top, region.left, region.height, region.width);
        assert_eq!(part, expected.data(), "{region:?} differs from the same part of the whole");
    }
}

/// The radiance of one picture with the guides of another is a picture of its own, which g_c corrects by itself. Fails where a view
/// takes a distance, a row or a sum of another.
#[test]
fn views_at_once_are_what_each_is_by_itself() {
    let rng = &mut Rng::new(17);
    let (height, width, radius, form) = (31, 80, 5, Form::Gated);
    let region = Region { top: 2, left: 1, height: 27, width: 78 };
    let taps = Taps::square(radius);
    for (set, missing) in [
        (FeatureSet::ALL, false),
        (FeatureSet { visibility: false, ..FeatureSet::ALL }, true),
        (FeatureSet { albedo: true, ..FeatureSet::NONE }, false),
    ] {
        let [a, b, guides] = [(); 3].map(|()| features(rng, height, width));
        let with_radiance = |of: &Image| {
            Image::from_fn(FEATURE_CHANNELS, height, width, |c, y, x| {
                if c < ALBEDO { of.at(c, y, x) } else { guides.at(c, y, x) }
            })
        };
        let (a_by_guides, b_by_guides) = (with_radiance(&a), with_radiance(&b));
        let valid = Image::from_fn(1, height, width, |_, _, _| f32::from(rng.uniform() > 0.2));
        let windows = |image: &Image| Windows::new(image, missing.then_some(&valid), set, radius);
        let [a, b, guides, a_by_guides, b_by_guides] = [&a, &b, &guides, &a_by_guides, &b_by_guides].map(windows);
        let parameters = [(); 2].map(|()| {
            let mut p = outputs(rng, form, region.pixels(), 1.0);
            parameters::activate(Isa::best(), form, &mut p);
            p
        });
        let [of_a, of_b] = parameters.each_ref().map(|p| ParameterPlanes::of_region(form, p, &region));
        let views = [(&a, &a, of_a), (&a, &guides, of_a), (&b, &guides, of_b), (&b, &b, of_b), (&a, &b, of_a)];
        let views = views.map(|(radiance, guides, parameters)| View { radiance, guides, parameters }).to_vec();
        let joint = JointCorrection { views, taps: &taps, region };
        for isa in Isa::available() {
            let mut found = vec![0.0; 5 * 3 * region.pixels()];
            joint.clone().forward(isa, &mut found);
            let alone = [(&a, of_a), (&a_by_guides, of_a), (&b_by_guides, of_b), (&b, of_b)];
            for (at, (windows, parameters)) in alone.into_iter().enumerate() {
                let mut expected = vec![0.0; 3 * region.pixels()];
                Correction { windows, taps: &taps, region, parameters }.forward(isa, &mut expected);
                let found = &found[at * expected.len()..][..expected.len()];
                assert!(found == expected, "view {at} under {}, {set:?}", isa.name());
            }
            for part in joint.in_parts(7) {
                let (at, region) = (part.region, joint.region);
                let mut of_part = vec![0.0; 5 * 3 * at.pixels()];
                part.forward(isa, &mut of_part);
                let whole = Image::from_planes(15, region.height, region.width, found.clone());
                let expected = whole.crop(at.top - region.top, at.left - region.left, at.height, at.width);
                assert!(of_part == expected.data(), "{at:?} under {}", isa.name());
            }
        }
    }
}

#[test]
#[should_panic(expected = "one shape and one set of features")]
fn views_of_other_features_are_refused() {
    let rng = &mut Rng::new(18);
    let (region, image) = (Region::whole(4, 5), features(rng, 4, 5));
    let [radiance, guides] = [FeatureSet::ALL, FeatureSet::NONE].map(|set| Windows::new(&image, None, set, 2));
    let p = vec![0.5; Form::Gated.parameters() * region.pixels()];
    let parameters = ParameterPlanes::of_region(Form::Gated, &p, &region);
    let views = vec![View { radiance: &radiance, guides: &guides, parameters }];
    let joint = JointCorrection { views, taps: &Taps::square(2), region };
    joint.forward(Isa::best(), &mut vec![0.0; 3 * region.pixels()]);
}

#[test]
fn the_network_and_its_gradient_match_the_oracle() {
    for (height, width) in [(1, 1), (7, 33), (16, 5), (9, 64)] {
        let rng = &mut Rng::new(height as u64);
        let shape = Shape { layers: 4, ..Shape::paper(Form::Gated) };
        let weights: Vec<f32> = (0..shape.parameter_count()).map(|_| 0.15 * rng.normal()).collect();
        let pixels = height * width;
        let input: Vec<f32> = (0..FEATURE_CHANNELS * pixels).map(|_| rng.uniform()).collect();
        let upstream: Vec<f32> = (0..shape.outputs * pixels).map(|_| rng.normal()).collect();
        let exact = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<f64>>();
        let (w, x, up) = (exact(&weights), exact(&input), exact(&upstream));
        let truth = network::oracle::forward(&shape, &w, &x, height, width).pop().unwrap_or_default();
        let truth_gradient = network::oracle::backward(&shape, &w, &x, height, width, &up);
        for isa in Isa::available() {
            let pass = Pass::forward(isa, &shape, &weights, &input, height, width);
            let scale = |truth: &[f64]| truth.iter().fold(1e-20f64, |m, t| m.max(t.abs()));
            let error = worst(&pass.outputs, &truth, scale(&truth));
            assert!(error < NETWORK_TOLERANCE, "{} {height}x{width}: forward {error:e}", isa.name());
            let error = worst(&pass.backward(&upstream), &truth_gradient, scale(&truth_gradient));
            assert!(error < NETWORK_TOLERANCE, "{} {height}x{width}: gradient {error:e}", isa.name());
        }
    }
}

#[test]
fn windows_of_the_network_do_not_show() {
    let rng = &mut Rng::new(3);
    let shape = Shape::paper(Form::Gated);
    let weights = (0..shape.parameter_count()).map(|_| 0.1 * rng.normal()).collect();
    let network = Network { shape, weights };
    let image = features(rng, 131, 117);
    let tiled = method::parameters(&method::window_network(Form::Gated, &network), &image);
    let mut whole = vec![0.0; shape.outputs * 131 * 117];
    method::window_network(Form::Gated, &network).run(image.data(), 131, 117, &mut whole);
    assert_eq!(tiled.data(), whole, "the network's windows differ from the whole picture");
}

#[test]
fn training_and_pictures_get_the_same_parameters() {
    let rng = &mut Rng::new(3);
    let shape = Shape::paper(Form::Gated);
    let weights = (0..shape.parameter_count()).map(|_| 0.1 * rng.normal()).collect();
    let network = Network { shape, weights };
    let image = features(rng, 31, 57);
    let streamed = method::parameters(&method::window_network(Form::Gated, &network), &image);
    let isa = Isa::best();
    let of_training = Pass::forward(isa, &shape, &network.weights, image.data(), 31, 57).outputs;
    let of_training: Vec<f64> = activated(isa, Form::Gated, &of_training).iter().map(|&v| f64::from(v)).collect();
    let planes = streamed.data().chunks_exact(31 * 57).zip(of_training.chunks_exact(31 * 57));
    for (c, (got, expected)) in planes.enumerate() {
        let error = worst(got, expected, expected.iter().fold(1e-20, |m: f64, v| m.max(v.abs())));
        assert!(error < NETWORK_TOLERANCE, "parameter {c}: {error:e}");
    }
}
