//! g_c, the gate, and the gradients of every parameter group.

use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::Taps;
use sspc_kernels::network::{Network, Shape};
use sspc_kernels::parameters::{Form, activate_backward};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_testkit::case::{Array, Case};
use sspc_testkit::closeness::{Relative, assert_close, assert_sensitive, compare, largest};
use sspc_testkit::kernels::{activated, correct, correct_and_back};
use sspc_train::combination::Combination;

/// 361 weights of a few roundings each (exp2, log2), averaged: below 1e-6 of the sum's terms, and
/// a sum's terms are up to ten times the sum; beyond that see [`Relative::ToTerms`].
const FORWARD: f64 = 1e-5;
/// Of the largest gradient of the parameter group in the case: sums of terms of both signs.
const GRADIENT: f64 = 1e-4;
/// Share of |G| |μ̂| below which a group's largest gradient counts as zero. It is made of differences
/// u_i - g, which vanish in a picture of one pixel but for their rounding: 6e-8 of |μ̂|, over the sum
/// of up to 361 weights.
const NO_GRADIENT: f64 = 1e-5;

/// The parameters by what they are; each is compared with its own largest gradient.
const GROUPS: [(&str, usize, usize); 10] = [
    ("beta z", 0, 3),
    ("beta rho", 3, 6),
    ("beta n", 6, 9),
    ("gamma rho", 9, 10),
    ("gamma n", 10, 11),
    ("gamma v", 11, 12),
    ("gamma y", 12, 13),
    ("gamma z", 13, 14),
    ("tau", 14, 15),
    ("gate", 15, 16),
];

/// A case made ready for the kernels.
struct Setup {
    form: Form,
    windows: Windows,
    taps: Taps,
    region: Region,
    raw: Vec<f32>,
    parameters: Vec<f32>,
    upstream: Vec<f32>,
}

impl Setup {
    fn new(case: &Case) -> Self {
        let (height, width) = case.size("features");
        let outputs = case.count("outputs");
        let form = if outputs == Form::Gated.parameters() { Form::Gated } else { Form::Paper };
        let features = case.get("features", &[FEATURE_CHANNELS, height, width]).f32();
        let features = Image::from_planes(FEATURE_CHANNELS, height, width, features);
        let present = |name: &str| case.facts["features"].as_array().expect("features").iter().any(|f| f == name);
        let set =
            FeatureSet { albedo: present("albedo"), normal: present("normal"), visibility: present("visibility") };
        let taps = Taps::square(case.count("radius"));
        let windows = Windows::new(&features, None, set, taps.radius());
        Self {
            form,
            region: Region::whole(height, width),
            windows,
            taps,
            raw: case.get("raw", &[outputs, height, width]).f32(),
            parameters: case.get("parameters", &[outputs, height, width]).f32(),
            upstream: case.get("upstream", &[3, height, width]).f32(),
        }
    }

    fn correct(&self, isa: Isa, form: Form, parameters: &[f32]) -> Vec<f32> {
        correct(isa, form, &self.windows, &self.taps, self.region, parameters)
    }

    fn gradient(&self, isa: Isa, parameters: &[f32]) -> Vec<f32> {
        correct_and_back(isa, self.form, &self.windows, &self.taps, self.region, parameters, &self.upstream).1
    }
}

#[test]
fn g_c_and_mu_hat_match() {
    for case in Case::of_kind("gc") {
        let setup = Setup::new(&case);
        let shape = [3, setup.region.height, setup.region.width];
        let (g, mu_hat) = (case.get("g", &shape), case.get("mu_hat", &shape));
        let relative = Relative::ToTerms { magnitude: &case.get("magnitude", &shape).values };
        for isa in Isa::available() {
            let stage = |what: &str| format!("{} {} {what}", case.name, isa.name());
            let paper = &setup.parameters[..15 * setup.region.pixels()];
            let found = setup.correct(isa, Form::Paper, paper);
            let worst_g = assert_close(&stage("g"), g, &found, relative, FORWARD);
            let found = setup.correct(isa, setup.form, &activated(isa, setup.form, &setup.raw));
            let worst = assert_close(&stage("mu_hat"), mu_hat, &found, relative, FORWARD);
            println!("{}: worst {:.1e}, from raw outputs {:.1e}", stage("g"), worst_g.0, worst.0);
        }
        let condition = mu_hat.values.iter().zip(&case.get("magnitude", &shape).values).map(|(v, m)| m / v.abs());
        println!("{}: largest condition number {:.0}", case.name, condition.fold(0.0, f64::max));
    }
}

#[test]
fn gradients_match_in_every_group() {
    for case in Case::of_kind("gc") {
        let setup = Setup::new(&case);
        let outputs = setup.form.parameters();
        let shape = [outputs, setup.region.height, setup.region.width];
        let corrected = [3, setup.region.height, setup.region.width];
        let terms = largest(case.get("upstream", &corrected)) * largest(case.get("magnitude", &corrected));
        let zero = NO_GRADIENT * terms;
        let (by_parameters, by_raw) = (case.get("d_parameters", &shape), case.get("d_raw", &shape));
        for isa in Isa::available() {
            let mut gradient = setup.gradient(isa, &setup.parameters);
            check_groups(&format!("{} {} d_parameters", case.name, isa.name()), by_parameters, &gradient, zero);
            activate_backward(isa, setup.form, &setup.raw, &mut gradient);
            check_groups(&format!("{} {} d_raw", case.name, isa.name()), by_raw, &gradient, zero);
        }
    }
}

/// Compares every group with its own largest gradient, or with `zero` where that is larger.
fn check_groups(stage: &str, expected: &Array, found: &[f32], zero: f64) {
    let pixels = expected.shape[1] * expected.shape[2];
    let groups = GROUPS.iter().filter(|group| group.2 <= expected.shape[0]);
    let mut worst = (0.0, "");
    for &(name, first, last) in groups {
        let part = expected.slab(first, last);
        let scale = largest(&part).max(zero);
        let error = assert_close(
            &format!("{stage} of {name}"),
            &part,
            &found[first * pixels..last * pixels],
            Relative::ToScale(scale),
            GRADIENT,
        );
        if error.0 >= worst.0 {
            worst = (error.0, name);
        }
    }
    println!("{stage}: worst {:.1e} ({})", worst.0, worst.1);
}

/// What a wrong constant of the kernel (a scale of a bandwidth, the centre weight, a slope) would do
/// to the two tests above: each channel of the parameters scaled, one after another.
#[test]
fn a_wrong_constant_of_any_parameter_is_caught() {
    let case = Case::named("gc-gated");
    let setup = Setup::new(&case);
    let pixels = setup.region.pixels();
    let shape = [3, setup.region.height, setup.region.width];
    let mu_hat = case.get("mu_hat", &shape);
    let relative = Relative::ToTerms { magnitude: &case.get("magnitude", &shape).values };
    let gradient = case.get("d_parameters", &[16, setup.region.height, setup.region.width]);
    let isa = Isa::best();
    let scaled = |first: usize, last: usize, error: f64| {
        let mut parameters = setup.parameters.clone();
        parameters[first * pixels..last * pixels].iter_mut().for_each(|p| *p *= 1.0 + error as f32);
        parameters
    };
    for (name, first, last) in GROUPS {
        assert_sensitive(&format!("forward, {name}"), |error| {
            let found = setup.correct(isa, setup.form, &scaled(first, last, error));
            compare("perturbed", mu_hat, &found, relative, FORWARD).is_err()
        });
        assert_sensitive(&format!("gradient, {name}"), |error| {
            let found = setup.gradient(isa, &scaled(first, last, error));
            GROUPS.iter().any(|&(_, first, last)| {
                let (part, found) = (gradient.slab(first, last), &found[first * pixels..last * pixels]);
                compare("perturbed", &part, found, Relative::ToScale(largest(&part)), GRADIENT).is_err()
            })
        });
    }
}

/// f_c as the trainer makes it: the slopes of the case replaced by the biases that hold them.
#[test]
fn the_trainers_f_c_is_the_cases() {
    let case = Case::named("fc");
    let setup = Setup::new(&case);
    let shape = Shape::paper(setup.form);
    let mut network = Network { shape, weights: vec![1.0; shape.parameter_count()] };
    Combination::DeepCombiner.fix(&mut network);
    let (kernel, bias) = network.layer(shape.layers - 1);
    let (pixels, slopes) = (setup.region.pixels(), 9);
    assert!(kernel[..slopes * kernel.len() / shape.outputs].iter().all(|w| *w == 0.0), "the slopes see nothing");
    let mut raw = setup.raw.clone();
    for (plane, bias) in raw.chunks_exact_mut(pixels).zip(bias).take(slopes) {
        plane.fill(*bias);
    }
    let size = [3, setup.region.height, setup.region.width];
    let (expected, magnitude) = (case.get("mu_hat", &size), &case.get("magnitude", &size).values);
    for isa in Isa::available() {
        let found = setup.correct(isa, setup.form, &activated(isa, setup.form, &raw));
        assert_close(&format!("fc {}", isa.name()), expected, &found, Relative::ToTerms { magnitude }, FORWARD);
    }
}
