//! Layout and activation of the network's outputs: the parameters of g_c at every pixel.
//!
//! | channel | parameter | activation of the output o |
//! |---|---|---|
//! | 0..8 | slopes β: z rgb, ρ rgb, n rgb | tanh(o) |
//! | 9..13 | bandwidths γ: ρ, n, v, y, z | 1 / (softplus(o)² + 1e-4) |
//! | 14 | weight τ of the centre pixel | softplus(o) + 1e-4 |
//! | 15 | gate s towards z (gated form only) | 1 / (1 + e^-o) |

use crate::simd::{Isa, Kernel, Simd, dispatch};

/// First slope of z; those of ρ and n follow.
pub const SLOPES: usize = 0;
/// Slopes of z.
pub const DENOISED_SLOPES: usize = 3;
/// Slopes in all.
pub const SLOPE_COUNT: usize = 9;
/// First bandwidth, in the order ρ, n, v, y, z.
pub const BANDWIDTHS: usize = 9;
/// Bandwidths in all.
pub const BANDWIDTH_COUNT: usize = 5;
/// Weight of the centre pixel.
pub const CENTRE: usize = 14;
/// Gate towards z.
pub const GATE: usize = 15;

/// Smallest softplus(o)² of a bandwidth and smallest centre weight.
pub const ACTIVATION_FLOOR: f64 = 1e-4;
const FLOOR: f32 = ACTIVATION_FLOOR as f32;

/// Names of the gated form's parameters, in order; the paper's form has the first 15.
const NAMES: [&str; 16] = [
    "beta_z.R",
    "beta_z.G",
    "beta_z.B",
    "beta_rho.R",
    "beta_rho.G",
    "beta_rho.B",
    "beta_n.X",
    "beta_n.Y",
    "beta_n.Z",
    "gamma_rho",
    "gamma_n",
    "gamma_v",
    "gamma_y",
    "gamma_z",
    "tau",
    "gate",
];

/// Which corrector the parameters belong to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// μ̂ = g_c, 15 parameters (the paper's Eq. 10).
    Paper,
    /// μ̂ = z + s (g_c - z), 16 parameters: z is within reach.
    Gated,
}

impl Form {
    /// Parameters per pixel.
    pub fn parameters(self) -> usize {
        match self {
            Form::Paper => 15,
            Form::Gated => 16,
        }
    }

    /// Names of the parameters, in order, as the model contract states them.
    pub fn parameter_names(self) -> &'static [&'static str] {
        &NAMES[..self.parameters()]
    }
}

/// Activates planar outputs `[form.parameters(), pixels]` in place.
pub fn activate(isa: Isa, form: Form, values: &mut [f32]) {
    assert_eq!(values.len() % form.parameters(), 0, "whole planes of parameters");
    let pixels = (values.len() / form.parameters()).max(1);
    for (channel, plane) in values.chunks_exact_mut(pixels).enumerate() {
        activate_plane(isa, channel, plane);
    }
}

/// Activates one plane of parameter `channel` in place.
pub fn activate_plane(isa: Isa, channel: usize, values: &mut [f32]) {
    dispatch(isa, ActivatePlane { channel, values });
}

/// Turns the gradient of activated parameters into that of the outputs `raw`, in place.
pub fn activate_backward(isa: Isa, form: Form, raw: &[f32], gradient: &mut [f32]) {
    assert_eq!(raw.len(), gradient.len(), "one gradient per output");
    assert_eq!(raw.len() % form.parameters(), 0, "whole planes of parameters");
    dispatch(isa, ActivateBackward { form, raw, gradient });
}

/// softplus(o) and its derivative.
#[inline(always)]
fn softplus<S: Simd>(s: S, o: S::F) -> (S::F, S::F) {
    let e = exp_of_minus_magnitude(s, o, 1.0);
    let log = s.mul(s.log2_1p(e), s.splat(std::f32::consts::LN_2));
    (s.add(s.max(o, s.zero()), log), sigmoid_of(s, o, e))
}

/// exp(-factor |o|)
#[inline(always)]
fn exp_of_minus_magnitude<S: Simd>(s: S, o: S::F, factor: f32) -> S::F {
    s.exp2(s.mul(s.abs(o), s.splat(-factor * std::f32::consts::LOG2_E)))
}

/// 1 / (1 + e^-o) given e = exp(-|o|).
#[inline(always)]
fn sigmoid_of<S: Simd>(s: S, o: S::F, e: S::F) -> S::F {
    let one = s.splat(1.0);
    let small = s.div(e, s.add(one, e));
    // o > 0: 1 - small, else small; 1 / (1 + e) keeps its precision either way.
    s.add(s.sub(small, s.where_positive(o, small)), s.where_positive(o, s.div(one, s.add(one, e))))
}

/// tanh(o) and its derivative.
#[inline(always)]
fn tanh<S: Simd>(s: S, o: S::F) -> (S::F, S::F) {
    let one = s.splat(1.0);
    let e = exp_of_minus_magnitude(s, o, 2.0);
    let sum = s.add(one, e);
    let value = s.copysign(s.div(s.sub(one, e), sum), o);
    (value, s.div(s.mul(s.splat(4.0), e), s.mul(sum, sum)))
}

/// Value and derivative of parameter `channel` at output `o`.
#[inline(always)]
fn activation<S: Simd>(s: S, channel: usize, o: S::F) -> (S::F, S::F) {
    match channel {
        0..SLOPE_COUNT => tanh(s, o),
        BANDWIDTHS..CENTRE => {
            let (softplus, slope) = softplus(s, o);
            let value = s.div(s.splat(1.0), s.fma(softplus, softplus, s.splat(FLOOR)));
            // Small factors first: softplus alone may be as large as f32 goes.
            let slope = s.mul(s.mul(s.splat(-2.0), slope), value);
            (value, s.mul(slope, s.mul(softplus, value)))
        }
        CENTRE => {
            let (softplus, slope) = softplus(s, o);
            (s.add(softplus, s.splat(FLOOR)), slope)
        }
        _ => {
            let e = exp_of_minus_magnitude(s, o, 1.0);
            let sum = s.add(s.splat(1.0), e);
            (sigmoid_of(s, o, e), s.div(e, s.mul(sum, sum)))
        }
    }
}

/// What [`run_plane`] writes for the outputs `raw` of one channel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pass {
    /// The activated parameters.
    Value,
    /// What is there times the activation's derivative.
    Gradient,
}

/// One pass over a plane. No closure: one would not be compiled for the instruction set of the
/// function that it is called in.
#[inline(always)]
fn run_plane<S: Simd>(s: S, channel: usize, pass: Pass, raw: &[f32], out: &mut [f32]) {
    for (raw, out) in raw.chunks(S::LANES).zip(out.chunks_mut(S::LANES)) {
        let (value, slope) = activation(s, channel, s.load_part(raw));
        let result = match pass {
            Pass::Value => value,
            Pass::Gradient => s.mul(s.load_part(out), slope),
        };
        s.store_part(out, result);
    }
}

struct ActivatePlane<'a> {
    channel: usize,
    values: &'a mut [f32],
}

impl Kernel for ActivatePlane<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let raw = self.values.to_vec();
        run_plane(s, self.channel, Pass::Value, &raw, self.values);
    }
}

struct ActivateBackward<'a> {
    form: Form,
    raw: &'a [f32],
    gradient: &'a mut [f32],
}

impl Kernel for ActivateBackward<'_> {
    type Output = ();
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let pixels = (self.raw.len() / self.form.parameters()).max(1);
        let planes = self.raw.chunks_exact(pixels).zip(self.gradient.chunks_exact_mut(pixels));
        for (channel, (raw, gradient)) in planes.enumerate() {
            run_plane(s, channel, Pass::Gradient, raw, gradient);
        }
    }
}

/// The activation of parameter `channel` in f64: value and derivative at output `o`.
pub fn activation_f64(channel: usize, o: f64) -> (f64, f64) {
    let sigmoid = 1.0 / (1.0 + (-o).exp());
    let softplus = o.max(0.0) + (-o.abs()).exp().ln_1p();
    // The derivative of 1 / (1 + e^-o), without a difference of nearly equal numbers.
    let bell = |o: f64| (-o.abs()).exp() / (1.0 + (-o.abs()).exp()).powi(2);
    match channel {
        0..SLOPE_COUNT => (o.tanh(), 4.0 * bell(2.0 * o)),
        BANDWIDTHS..CENTRE => {
            let value = 1.0 / (softplus * softplus + ACTIVATION_FLOOR);
            (value, -2.0 * softplus * sigmoid * value * value)
        }
        CENTRE => (softplus + ACTIVATION_FLOOR, sigmoid),
        _ => (sigmoid, bell(o)),
    }
}
