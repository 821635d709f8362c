//! From the sums over a window to g_c, μ̂ and the gradient of the parameters.

use super::WEIGHT_FLOOR;
use super::strip::PITCH;
use super::sweep::{DISTANCE_SUMS, MOMENTS, RADIANCE_SUMS, SLOPE_SUMS, WEIGHT};
use super::vector::{difference, dot, load3, vectors};
use crate::features::{DENOISED, FEATURE_CHANNELS, RADIANCE};
use crate::parameters::{BANDWIDTHS, CENTRE, Form, GATE, SLOPE_COUNT, SLOPES};
use crate::simd::Simd;

/// Parameters of the form that has most.
pub(super) const MAX_PARAMETERS: usize = 16;

/// One vector of pixels, its window complete.
pub(super) struct Complete<S: Simd> {
    parameters: [S::F; MAX_PARAMETERS],
    y: [S::F; 3],
    z: [S::F; 3],
    /// 1 where a pixel counts, 0 where it is missing.
    valid: S::F,
    sums: *const f32,
    /// 1 / max(Σw, floor).
    inverse: S::F,
    /// Σw is above its floor: 1, else 0.
    free: S::F,
    g: [S::F; 3],
}

impl<S: Simd> Complete<S> {
    /// # Safety
    /// The machine must have `S`; `centre` must lead to the pixels in a copied row, `sums` to theirs.
    #[inline(always)]
    pub(super) unsafe fn new(
        parameters: [S::F; MAX_PARAMETERS],
        masked: bool,
        centre: *const f32,
        sums: *const f32,
    ) -> Self {
        unsafe {
            let y = load3::<S>(centre.add(RADIANCE * PITCH));
            let valid = if masked { S::load(centre.add(FEATURE_CHANNELS * PITCH)) } else { S::splat(1.0) };
            let w_c = S::mul(parameters[CENTRE], valid);
            let weight = S::add(S::load(sums.add(WEIGHT * S::LANES)), w_c);
            let floor = S::splat(WEIGHT_FLOOR);
            let inverse = S::div(S::splat(1.0), S::max(weight, floor));
            let radiance: [S::F; 3] = vectors::<S, 3>(sums, RADIANCE_SUMS);
            let mut g = radiance;
            for k in 0..3 {
                g[k] = S::fma(w_c, y[k], g[k]);
            }
            for i in 0..SLOPE_COUNT {
                let sum = S::load(sums.add((SLOPE_SUMS + i) * S::LANES));
                g[i % 3] = S::fma(parameters[SLOPES + i], sum, g[i % 3]);
            }
            for k in 0..3 {
                g[k] = S::mul(g[k], inverse);
            }
            let free = S::where_positive(S::sub(weight, floor), S::splat(1.0));
            let z = load3::<S>(centre.add(DENOISED * PITCH));
            Self { parameters, y, z, valid, sums, inverse, free, g }
        }
    }

    /// μ̂: z + s (g - z), or g in the paper's form.
    #[inline(always)]
    pub(super) unsafe fn corrected(&self, form: Form) -> [S::F; 3] {
        let mut corrected = self.g;
        if form == Form::Gated {
            for k in 0..3 {
                corrected[k] = unsafe { S::fma(self.parameters[GATE], S::sub(self.g[k], self.z[k]), self.z[k]) };
            }
        }
        corrected
    }

    /// Gradient of all parameters, given that of μ̂.
    #[inline(always)]
    pub(super) unsafe fn gradient(&self, form: Form, upstream: [S::F; 3]) -> [S::F; MAX_PARAMETERS] {
        unsafe {
            let mut gradient = [S::zero(); MAX_PARAMETERS];
            let mut by_g = upstream;
            if form == Form::Gated {
                gradient[GATE] = dot::<S>(&upstream, &difference::<S>(&self.g, &self.z));
                by_g = scaled::<S>(&upstream, self.parameters[GATE]);
            }
            // By the sums: G / Σw.
            let by_sum = scaled::<S>(&by_g, self.inverse);
            for i in 0..SLOPE_COUNT {
                let sum = S::load(self.sums.add((SLOPE_SUMS + i) * S::LANES));
                gradient[SLOPES + i] = S::mul(by_sum[i % 3], sum);
            }
            // A floored Σw no longer depends on the weights.
            let held = scaled::<S>(&self.g, self.free);
            let by_centre = dot::<S>(&by_sum, &difference::<S>(&self.y, &held));
            gradient[CENTRE] = S::mul(by_centre, self.valid);
            // Σ w d_m G·(u_i - held) from the sums relative to z_c.
            let held = difference::<S>(&held, &self.z);
            for m in 0..5 {
                let distance = S::load(self.sums.add((DISTANCE_SUMS + m) * S::LANES));
                let moments: [S::F; 3] = vectors::<S, 3>(self.sums, MOMENTS + 3 * m);
                let about_g = difference::<S>(&moments, &scaled::<S>(&held, distance));
                // The logarithms are kept to the base 2.
                let unit = if m < 3 { -1.0 } else { -std::f32::consts::LN_2 };
                gradient[BANDWIDTHS + m] = S::mul(dot::<S>(&by_sum, &about_g), S::splat(unit));
            }
            gradient
        }
    }
}

#[inline(always)]
unsafe fn scaled<S: Simd>(a: &[S::F; 3], factor: S::F) -> [S::F; 3] {
    unsafe { [S::mul(a[0], factor), S::mul(a[1], factor), S::mul(a[2], factor)] }
}
