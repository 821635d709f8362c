//! From the sums over a window to g_c, μ̂ and the gradient of the parameters.

use super::WEIGHT_FLOOR;
use super::strip::PITCH;
use super::tap_sums::{KEPT, MOMENTS, RADIANCE_SUMS, SCALE, SLOPE_SUMS, WEIGHT};
use super::vector::{difference, dot, load_vectors, load3, scaled};
use crate::features::{DENOISED, FEATURE_CHANNELS, RADIANCE};
use crate::parameters::{BANDWIDTH_COUNT, BANDWIDTHS, CENTRE, Form, GATE, SLOPE_COUNT, SLOPES};
use crate::simd::Simd;

/// Parameters of the form that has most.
pub(super) const MAX_PARAMETERS: usize = 16;

/// One vector of pixels, its window complete.
pub(super) struct Complete<'a, S: Simd> {
    s: S,
    parameters: [S::F; MAX_PARAMETERS],
    y: [S::F; 3],
    z: [S::F; 3],
    /// 1 where a pixel counts, 0 where it is missing.
    valid: S::F,
    sums: &'a [f32],
    /// 1 / max(Σw, floor), of scaled weights.
    inverse: S::F,
    /// Σw is above its floor: 1, else 0.
    free: S::F,
    g: [S::F; 3],
}

impl<'a, S: Simd> Complete<'a, S> {
    /// From the sums over the taps of the pixels with which the planes `centre` begin.
    #[inline(always)]
    pub(super) fn new(s: S, parameters: [S::F; MAX_PARAMETERS], masked: bool, centre: &[f32], sums: &'a [f32]) -> Self {
        let y = load3(s, centre, RADIANCE);
        let valid = if masked { s.load(&centre[FEATURE_CHANNELS * PITCH..]) } else { s.splat(1.0) };
        let w_c = s.mul(s.mul(parameters[CENTRE], s.splat(SCALE)), valid);
        let weight = s.add(s.load(&sums[WEIGHT * S::LANES..]), w_c);
        let floor = s.splat(SCALE * WEIGHT_FLOOR);
        let inverse = s.div(s.splat(1.0), s.max(weight, floor));
        let mut g: [S::F; 3] = load_vectors(s, sums, RADIANCE_SUMS);
        for k in 0..3 {
            g[k] = s.fma(w_c, y[k], g[k]);
        }
        for i in 0..SLOPE_COUNT {
            let sum = s.load(&sums[(SLOPE_SUMS + i) * S::LANES..]);
            g[i % 3] = s.fma(parameters[SLOPES + i], sum, g[i % 3]);
        }
        let g = scaled(s, &g, inverse);
        let free = s.where_positive(s.sub(weight, floor), s.splat(1.0));
        let z = load3(s, centre, DENOISED);
        Self { s, parameters, y, z, valid, sums, inverse, free, g }
    }

    /// μ̂: z + s (g - z), or g in the paper's form.
    #[inline(always)]
    pub(super) fn corrected(&self, form: Form) -> [S::F; 3] {
        let Self { s, parameters, g, z, .. } = self;
        match form {
            Form::Paper => *g,
            Form::Gated => std::array::from_fn(|k| s.fma(parameters[GATE], s.sub(g[k], z[k]), z[k])),
        }
    }

    /// Gradient of all parameters, given that of μ̂.
    #[inline(always)]
    pub(super) fn gradient(&self, form: Form, upstream: [S::F; 3]) -> [S::F; MAX_PARAMETERS] {
        let s = self.s;
        let mut gradient = [s.zero(); MAX_PARAMETERS];
        let mut by_g = upstream;
        if form == Form::Gated {
            gradient[GATE] = dot(s, &upstream, &difference(s, &self.g, &self.z));
            by_g = scaled(s, &upstream, self.parameters[GATE]);
        }
        // By the sums: G / Σw. The sums are scaled, so that what is made of them is.
        let by_sum = scaled(s, &by_g, s.mul(self.inverse, s.splat(SCALE)));
        for i in 0..SLOPE_COUNT {
            let sum = s.load(&self.sums[(SLOPE_SUMS + i) * S::LANES..]);
            gradient[SLOPES + i] = unscaled(s, s.mul(by_sum[i % 3], sum));
        }
        // A floored Σw no longer depends on the weights.
        let held = scaled(s, &self.g, self.free);
        let by_centre = dot(s, &by_sum, &difference(s, &self.y, &held));
        gradient[CENTRE] = s.mul(by_centre, self.valid);
        // Σ w d_m G·(u_i - held) from the sums relative to z_c.
        let held = difference(s, &held, &self.z);
        for m in 0..BANDWIDTH_COUNT {
            let [distance, r, g, b] = load_vectors(s, self.sums, MOMENTS + KEPT * m);
            let about_g = difference(s, &[r, g, b], &scaled(s, &held, distance));
            // The logarithms are kept to the base 2.
            let unit = if m < 3 { -1.0 } else { -std::f32::consts::LN_2 };
            gradient[BANDWIDTHS + m] = unscaled(s, s.mul(dot(s, &by_sum, &about_g), s.splat(unit)));
        }
        gradient
    }
}

/// Gradients of parameters that are not larger are 0.
const FAINTEST_GRADIENT: f32 = 1.0 / (1_u128 << 120) as f32;

/// `scaled` / [`SCALE`], and 0 where that would be next to nothing: subnormal gradients would go through the whole network.
#[inline(always)]
fn unscaled<S: Simd>(s: S, scaled: S::F) -> S::F {
    let above = s.sub(s.abs(scaled), s.splat(SCALE * FAINTEST_GRADIENT));
    s.mul(s.where_positive(above, scaled), s.splat(1.0 / SCALE))
}
