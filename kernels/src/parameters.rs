//! Layout and activation of the network's outputs: the parameters of g_c at every pixel.
//!
//! | channel | parameter | activation of the output o |
//! |---|---|---|
//! | 0..8 | slopes β: z rgb, ρ rgb, n rgb | tanh(o) |
//! | 9..13 | bandwidths γ: ρ, n, v, y, z | 1 / (softplus(o)² + 1e-4) |
//! | 14 | weight τ of the centre pixel | softplus(o) + 1e-4 |
//! | 15 | gate s towards z (gated form only) | 1 / (1 + e^-o) |

use crate::simd::{Isa, Kernel, MAX_LANES, Simd, dispatch};

/// First slope of z; those of ρ and n follow.
pub const SLOPES: usize = 0;
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
const FLOOR: f32 = 1e-4;

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

    /// The form that has `parameters` per pixel.
    pub fn from_parameters(parameters: usize) -> Option<Form> {
        [Form::Paper, Form::Gated].into_iter().find(|form| form.parameters() == parameters)
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

/// exp(-|o|), softplus(o) and its derivative.
#[inline(always)]
unsafe fn softplus<S: Simd>(o: S::F) -> (S::F, S::F) {
    unsafe {
        let magnitude = S::abs(o);
        let e = S::exp2(S::mul(magnitude, S::splat(-std::f32::consts::LOG2_E)));
        let log = S::mul(S::log2_1p(e), S::splat(std::f32::consts::LN_2));
        (S::add(S::max(o, S::zero()), log), sigmoid_of::<S>(o, e))
    }
}

/// 1 / (1 + e^-o) given e = exp(-|o|).
#[inline(always)]
unsafe fn sigmoid_of<S: Simd>(o: S::F, e: S::F) -> S::F {
    unsafe {
        let one = S::splat(1.0);
        let small = S::div(e, S::add(one, e));
        // o > 0: 1 - small, else small; 1 / (1 + e) keeps its precision either way.
        S::add(S::sub(small, S::where_positive(o, small)), S::where_positive(o, S::div(one, S::add(one, e))))
    }
}

/// tanh(o) and its derivative.
#[inline(always)]
unsafe fn tanh<S: Simd>(o: S::F) -> (S::F, S::F) {
    unsafe {
        let one = S::splat(1.0);
        let e = S::exp2(S::mul(S::abs(o), S::splat(-2.0 * std::f32::consts::LOG2_E)));
        let sum = S::add(one, e);
        let value = S::copysign(S::div(S::sub(one, e), sum), o);
        (value, S::div(S::mul(S::splat(4.0), e), S::mul(sum, sum)))
    }
}

/// Value and derivative of parameter `channel` at output `o`.
#[inline(always)]
unsafe fn activation<S: Simd>(channel: usize, o: S::F) -> (S::F, S::F) {
    unsafe {
        match channel {
            0..SLOPE_COUNT => tanh::<S>(o),
            BANDWIDTHS..CENTRE => {
                let (softplus, slope) = softplus::<S>(o);
                let value = S::div(S::splat(1.0), S::fma(softplus, softplus, S::splat(FLOOR)));
                // Small factors first: softplus alone may be as large as f32 goes.
                let slope = S::mul(S::mul(S::splat(-2.0), slope), value);
                (value, S::mul(slope, S::mul(softplus, value)))
            }
            CENTRE => {
                let (softplus, slope) = softplus::<S>(o);
                (S::add(softplus, S::splat(FLOOR)), slope)
            }
            _ => {
                let e = S::exp2(S::mul(S::abs(o), S::splat(-std::f32::consts::LOG2_E)));
                let value = sigmoid_of::<S>(o, e);
                let sum = S::add(S::splat(1.0), e);
                (value, S::div(e, S::mul(sum, sum)))
            }
        }
    }
}

/// What [`for_vectors`] writes for outputs `raw` of one channel.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Pass {
    /// The activated parameters.
    Value,
    /// What is there times the activation's derivative.
    Gradient,
}

/// Runs one pass over a slice in vectors; the last ones go through a padded copy. No closure: one
/// would not be compiled for the instruction set of the function that it is called in.
#[inline(always)]
unsafe fn for_vectors<S: Simd>(channel: usize, pass: Pass, raw: &[f32], out: &mut [f32]) {
    unsafe {
        let whole = raw.len() / S::LANES * S::LANES;
        for i in (0..whole).step_by(S::LANES) {
            let p = out.as_mut_ptr().add(i);
            S::store(p, one_vector::<S>(channel, pass, S::load(raw.as_ptr().add(i)), S::load(p)));
        }
        let mut o = [0.0; MAX_LANES];
        let mut v = [0.0; MAX_LANES];
        let rest = raw.len() - whole;
        o[..rest].copy_from_slice(&raw[whole..]);
        v[..rest].copy_from_slice(&out[whole..]);
        S::store(v.as_mut_ptr(), one_vector::<S>(channel, pass, S::load(o.as_ptr()), S::load(v.as_ptr())));
        out[whole..].copy_from_slice(&v[..rest]);
    }
}

#[inline(always)]
unsafe fn one_vector<S: Simd>(channel: usize, pass: Pass, o: S::F, there: S::F) -> S::F {
    unsafe {
        let (value, slope) = activation::<S>(channel, o);
        match pass {
            Pass::Value => value,
            Pass::Gradient => S::mul(there, slope),
        }
    }
}

struct ActivatePlane<'a> {
    channel: usize,
    values: &'a mut [f32],
}

impl Kernel for ActivatePlane<'_> {
    type Output = ();
    #[inline(always)]
    unsafe fn run<S: Simd>(self) {
        let raw = self.values.to_vec();
        // SAFETY: `for_vectors` stays inside its two slices of one length.
        unsafe { for_vectors::<S>(self.channel, Pass::Value, &raw, self.values) }
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
    unsafe fn run<S: Simd>(self) {
        let pixels = (self.raw.len() / self.form.parameters()).max(1);
        let planes = self.raw.chunks_exact(pixels).zip(self.gradient.chunks_exact_mut(pixels));
        for (channel, (raw, gradient)) in planes.enumerate() {
            // SAFETY: `for_vectors` stays inside its two slices of one length.
            unsafe { for_vectors::<S>(channel, Pass::Gradient, raw, gradient) }
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
            let value = 1.0 / (softplus * softplus + 1e-4);
            (value, -2.0 * softplus * sigmoid * value * value)
        }
        CENTRE => (softplus + 1e-4, sigmoid),
        _ => (sigmoid, bell(o)),
    }
}
