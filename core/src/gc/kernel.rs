//! g_c and its gradient for one row vector of pixels at a time, all taps.
//!
//! The forward sweep accumulates Σw, Σw y_i and Σw (x_c - x_i) for x = z, ρ, n: slopes are constant
//! over the window, so they multiply the sums, not the terms. When a gradient is wanted the sweep
//! also keeps each tap's weight and distances (about 140 KiB, in L2), and a second, cheaper sweep
//! accumulates Σ w_i q_i d_i with q_i = G·(u_i - g), from which every bandwidth's gradient follows.

use super::{ParameterPlanes, Region, WEIGHT_FLOOR};
use crate::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, NORMAL, RADIANCE, VISIBILITY, Windows};
use crate::parameters::{BANDWIDTHS, CENTRE, Form, GATE, SLOPES};
use crate::simd::{Kernel, MAX_LANES, Simd};

/// Answers with the gradient of a loss by the corrected radiance.
pub trait Upstream {
    /// False leaves the backward sweep out.
    const NEEDED: bool;

    /// Gradient of the loss by μ̂ for the pixels (y, x .. x + lanes) of the region.
    ///
    /// # Safety
    /// Called by the kernel only, on a machine that has `S`.
    unsafe fn gradient<S: Simd>(&mut self, y: usize, x: usize, lanes: usize, corrected: [S::F; 3]) -> [S::F; 3];
}

/// Forward only.
pub struct NoUpstream;

impl Upstream for NoUpstream {
    const NEEDED: bool = false;

    #[inline(always)]
    unsafe fn gradient<S: Simd>(&mut self, _: usize, _: usize, _: usize, corrected: [S::F; 3]) -> [S::F; 3] {
        corrected
    }
}

pub(super) struct Correct<'a, U> {
    pub windows: &'a Windows,
    /// Taps as distances in floats from the centre.
    pub offsets: &'a [isize],
    pub region: Region,
    pub parameters: ParameterPlanes<'a>,
    pub upstream: &'a mut U,
    pub out: &'a mut [f32],
    pub gradient: &'a mut [f32],
}

/// Values kept per tap for the backward sweep: w, d_ρ, d_n, d_v, log2(1+d_y), log2(1+d_z).
const KEPT: usize = 6;
const MAX_PARAMETERS: usize = 16;

impl<U: Upstream> Kernel for Correct<'_, U> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<S: Simd>(self) {
        let region = self.region;
        let mut kept = vec![0.0; if U::NEEDED { self.offsets.len() * KEPT * S::LANES } else { 0 }];
        let form = self.parameters.form;
        for y in 0..region.height {
            for x in (0..region.width).step_by(S::LANES) {
                let lanes = S::LANES.min(region.width - x);
                // SAFETY: `gc::run` checked that region, parameters and outputs fit together. The
                // planes of `Windows` are padded by the window's radius and a vector to the right,
                // so all taps of a vector that starts inside the region lie in its data.
                unsafe {
                    let at = Block::<S>::new(self.windows, self.offsets, &region, y, x);
                    let p = load_parameters::<S>(&self.parameters, y, x, lanes);
                    let sums = at.forward::<U>(&p, kept.as_mut_ptr());
                    let g = at.combine(&p, &sums);
                    let corrected = at.gated(form, &p, &g);
                    let place = y * region.width + x;
                    store_planes::<S, 3>(self.out, region.pixels(), place, lanes, &corrected);
                    if U::NEEDED {
                        let upstream = self.upstream.gradient::<S>(y, x, lanes, corrected);
                        let gradient = at.backward(form, &p, &sums, &g, upstream, kept.as_ptr());
                        if form == Form::Gated {
                            store_planes::<S, MAX_PARAMETERS>(self.gradient, region.pixels(), place, lanes, &gradient);
                        } else {
                            let paper: [S::F; GATE] = std::array::from_fn(|i| gradient[i]);
                            store_planes::<S, GATE>(self.gradient, region.pixels(), place, lanes, &paper);
                        }
                    }
                }
            }
        }
    }
}

/// Loads `lanes` of a row; the rest of the vector is zero.
///
/// # Safety
/// The machine must have `S`.
#[inline(always)]
pub(crate) unsafe fn load_lanes<S: Simd>(source: &[f32], at: usize, lanes: usize) -> S::F {
    unsafe {
        if lanes == S::LANES {
            S::load(source[at..at + S::LANES].as_ptr())
        } else {
            let mut rest = [0.0; MAX_LANES];
            rest[..lanes].copy_from_slice(&source[at..at + lanes]);
            S::load(rest.as_ptr())
        }
    }
}

#[inline(always)]
unsafe fn load_parameters<S: Simd>(p: &ParameterPlanes, y: usize, x: usize, lanes: usize) -> [S::F; MAX_PARAMETERS] {
    unsafe {
        let at = p.start + y * p.row + x;
        std::array::from_fn(|i| {
            if i < p.form.parameters() { load_lanes::<S>(p.values, i * p.plane + at, lanes) } else { S::splat(1.0) }
        })
    }
}

#[inline(always)]
unsafe fn store_planes<S: Simd, const N: usize>(out: &mut [f32], plane: usize, at: usize, lanes: usize, v: &[S::F; N]) {
    unsafe {
        for (i, v) in v.iter().enumerate() {
            let at = i * plane + at;
            if lanes == S::LANES {
                S::store(out[at..at + lanes].as_mut_ptr(), *v);
            } else {
                let mut rest = [0.0; MAX_LANES];
                S::store(rest.as_mut_ptr(), *v);
                out[at..at + lanes].copy_from_slice(&rest[..lanes]);
            }
        }
    }
}

/// What the forward sweep adds up.
struct Sums<S: Simd> {
    /// 1 / max(Σw, floor).
    inverse: S::F,
    /// Σw is above its floor: 1, else 0.
    free: S::F,
    /// Σ w y_i, the centre included.
    radiance: [S::F; 3],
    /// Σ w (x_c - x_i) for x = z, ρ, n.
    slopes: [[S::F; 3]; 3],
}

/// One row vector of centre pixels.
struct Block<'a, S: Simd> {
    centre: *const f32,
    plane: usize,
    offsets: &'a [isize],
    set: FeatureSet,
    masked: bool,
    _simd: std::marker::PhantomData<S>,
}

/// First channels of the features that have slopes, in the order of the slopes.
const SLOPED: [usize; 3] = [DENOISED, ALBEDO, NORMAL];

impl<'a, S: Simd> Block<'a, S> {
    #[inline(always)]
    unsafe fn new(windows: &Windows, offsets: &'a [isize], region: &Region, y: usize, x: usize) -> Self {
        let at = windows.offset(region.top + y, region.left + x);
        Self {
            centre: unsafe { windows.data().as_ptr().add(at) },
            plane: windows.plane(),
            offsets,
            set: windows.set(),
            masked: windows.masked(),
            _simd: std::marker::PhantomData,
        }
    }

    #[inline(always)]
    unsafe fn load(&self, channel: usize, offset: isize) -> S::F {
        unsafe { S::load(self.centre.add(channel * self.plane).offset(offset)) }
    }

    #[inline(always)]
    unsafe fn load3(&self, channel: usize, offset: isize) -> [S::F; 3] {
        unsafe { [self.load(channel, offset), self.load(channel + 1, offset), self.load(channel + 2, offset)] }
    }

    #[inline(always)]
    unsafe fn forward<U: Upstream>(&self, p: &[S::F; MAX_PARAMETERS], kept: *mut f32) -> Sums<S> {
        unsafe {
            let negative = |gamma: S::F, unit: f32| S::mul(gamma, S::splat(-unit));
            let log2_e = std::f32::consts::LOG2_E;
            let albedo_width = negative(p[BANDWIDTHS], log2_e);
            let normal_width = negative(p[BANDWIDTHS + 1], log2_e);
            let visibility_width = negative(p[BANDWIDTHS + 2], log2_e);
            let radiance_width = negative(p[BANDWIDTHS + 3], 1.0);
            let denoised_width = negative(p[BANDWIDTHS + 4], 1.0);
            let y_c = self.load3(RADIANCE, 0);
            let z_c = self.load3(DENOISED, 0);
            let rho_c = self.load3(ALBEDO, 0);
            let n_c = self.load3(NORMAL, 0);
            let v_c = self.load(VISIBILITY, 0);

            let mut weight = S::zero();
            let mut radiance = [S::zero(); 3];
            let mut z_sum = [S::zero(); 3];
            let mut rho_sum = [S::zero(); 3];
            let mut n_sum = [S::zero(); 3];
            for (t, &offset) in self.offsets.iter().enumerate() {
                let keep = kept.add(if U::NEEDED { t * KEPT * S::LANES } else { 0 });
                let y_i = self.load3(RADIANCE, offset);
                let y_log = S::log2_1p(squared::<S>(&difference::<S>(&y_c, &y_i)));
                let dz = difference::<S>(&z_c, &self.load3(DENOISED, offset));
                let z_log = S::log2_1p(squared::<S>(&dz));
                let mut exponent = S::fma(radiance_width, y_log, S::mul(denoised_width, z_log));
                let mut drho = [S::zero(); 3];
                let mut dn = [S::zero(); 3];
                if self.set.albedo {
                    drho = difference::<S>(&rho_c, &self.load3(ALBEDO, offset));
                    let d = squared::<S>(&drho);
                    exponent = S::fma(albedo_width, d, exponent);
                    if U::NEEDED {
                        S::store(keep.add(S::LANES), d);
                    }
                }
                if self.set.normal {
                    dn = difference::<S>(&n_c, &self.load3(NORMAL, offset));
                    let d = squared::<S>(&dn);
                    exponent = S::fma(normal_width, d, exponent);
                    if U::NEEDED {
                        S::store(keep.add(2 * S::LANES), d);
                    }
                }
                if self.set.visibility {
                    let dv = S::sub(v_c, self.load(VISIBILITY, offset));
                    let d = S::mul(dv, dv);
                    exponent = S::fma(visibility_width, d, exponent);
                    if U::NEEDED {
                        S::store(keep.add(3 * S::LANES), d);
                    }
                }
                let mut w = S::exp2(exponent);
                if self.masked {
                    w = S::mul(w, self.load(FEATURE_CHANNELS, offset));
                }
                if U::NEEDED {
                    S::store(keep, w);
                    S::store(keep.add(4 * S::LANES), y_log);
                    S::store(keep.add(5 * S::LANES), z_log);
                }
                weight = S::add(weight, w);
                accumulate::<S>(&mut radiance, w, &y_i);
                accumulate::<S>(&mut z_sum, w, &dz);
                if self.set.albedo {
                    accumulate::<S>(&mut rho_sum, w, &drho);
                }
                if self.set.normal {
                    accumulate::<S>(&mut n_sum, w, &dn);
                }
            }
            let centre = if self.masked { S::mul(p[CENTRE], self.load(FEATURE_CHANNELS, 0)) } else { p[CENTRE] };
            weight = S::add(weight, centre);
            accumulate::<S>(&mut radiance, centre, &y_c);
            let floor = S::splat(WEIGHT_FLOOR);
            Sums {
                inverse: S::div(S::splat(1.0), S::max(weight, floor)),
                free: S::where_positive(S::sub(weight, floor), S::splat(1.0)),
                radiance,
                slopes: [z_sum, rho_sum, n_sum],
            }
        }
    }

    /// g_c of the sums.
    #[inline(always)]
    unsafe fn combine(&self, p: &[S::F; MAX_PARAMETERS], sums: &Sums<S>) -> [S::F; 3] {
        unsafe {
            std::array::from_fn(|k| {
                let mut g = sums.radiance[k];
                for (feature, sum) in sums.slopes.iter().enumerate() {
                    g = S::fma(p[SLOPES + 3 * feature + k], sum[k], g);
                }
                S::mul(g, sums.inverse)
            })
        }
    }

    /// z + s (g - z), or g in the paper's form.
    #[inline(always)]
    unsafe fn gated(&self, form: Form, p: &[S::F; MAX_PARAMETERS], g: &[S::F; 3]) -> [S::F; 3] {
        unsafe {
            if form == Form::Paper {
                return *g;
            }
            let z = self.load3(DENOISED, 0);
            std::array::from_fn(|k| S::fma(p[GATE], S::sub(g[k], z[k]), z[k]))
        }
    }

    /// Gradient of all parameters, given that of the corrected radiance.
    #[inline(always)]
    unsafe fn backward(
        &self,
        form: Form,
        p: &[S::F; MAX_PARAMETERS],
        sums: &Sums<S>,
        g: &[S::F; 3],
        upstream: [S::F; 3],
        kept: *const f32,
    ) -> [S::F; MAX_PARAMETERS] {
        unsafe {
            let mut gradient = [S::zero(); MAX_PARAMETERS];
            let mut by_g = upstream;
            if form == Form::Gated {
                let z = self.load3(DENOISED, 0);
                gradient[GATE] = dot::<S>(&upstream, &difference::<S>(g, &z));
                by_g = std::array::from_fn(|k| S::mul(upstream[k], p[GATE]));
            }
            // By the sums: G / Σw.
            let by_sum: [S::F; 3] = std::array::from_fn(|k| S::mul(by_g[k], sums.inverse));
            for (feature, sum) in sums.slopes.iter().enumerate() {
                for k in 0..3 {
                    gradient[SLOPES + 3 * feature + k] = S::mul(by_sum[k], sum[k]);
                }
            }
            let held: [S::F; 3] = std::array::from_fn(|k| S::mul(g[k], sums.free));
            let by_weight = dot::<S>(&by_sum, &held);
            let by_centre = dot::<S>(&by_sum, &difference::<S>(&self.load3(RADIANCE, 0), &held));
            gradient[CENTRE] = if self.masked { S::mul(by_centre, self.load(FEATURE_CHANNELS, 0)) } else { by_centre };
            let widths = self.bandwidth_sums(p, &by_sum, by_weight, kept);
            for (m, sum) in widths.iter().enumerate() {
                // The logarithms are kept to the base 2.
                let unit = if m < 3 { -1.0 } else { -std::f32::consts::LN_2 };
                gradient[BANDWIDTHS + m] = S::mul(*sum, S::splat(unit));
            }
            gradient
        }
    }

    /// Σ w_i q_i d_i for the five distances.
    #[inline(always)]
    unsafe fn bandwidth_sums(
        &self,
        p: &[S::F; MAX_PARAMETERS],
        by_sum: &[S::F; 3],
        by_weight: S::F,
        kept: *const f32,
    ) -> [S::F; 5] {
        unsafe {
            let weighted: [[S::F; 3]; 3] =
                std::array::from_fn(|f| std::array::from_fn(|k| S::mul(by_sum[k], p[SLOPES + 3 * f + k])));
            let centres: [[S::F; 3]; 3] = std::array::from_fn(|f| self.load3(SLOPED[f], 0));
            let taking_part = [true, self.set.albedo, self.set.normal];
            let mut sums = [S::zero(); 5];
            for (t, &offset) in self.offsets.iter().enumerate() {
                let keep = kept.add(t * KEPT * S::LANES);
                let mut q = S::sub(dot::<S>(by_sum, &self.load3(RADIANCE, offset)), by_weight);
                for f in 0..3 {
                    if taking_part[f] {
                        let d = difference::<S>(&centres[f], &self.load3(SLOPED[f], offset));
                        q = S::add(q, dot::<S>(&weighted[f], &d));
                    }
                }
                let wq = S::mul(S::load(keep), q);
                if self.set.albedo {
                    sums[0] = S::fma(wq, S::load(keep.add(S::LANES)), sums[0]);
                }
                if self.set.normal {
                    sums[1] = S::fma(wq, S::load(keep.add(2 * S::LANES)), sums[1]);
                }
                if self.set.visibility {
                    sums[2] = S::fma(wq, S::load(keep.add(3 * S::LANES)), sums[2]);
                }
                sums[3] = S::fma(wq, S::load(keep.add(4 * S::LANES)), sums[3]);
                sums[4] = S::fma(wq, S::load(keep.add(5 * S::LANES)), sums[4]);
            }
            sums
        }
    }
}

#[inline(always)]
unsafe fn difference<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> [S::F; 3] {
    unsafe { std::array::from_fn(|k| S::sub(a[k], b[k])) }
}

#[inline(always)]
unsafe fn dot<S: Simd>(a: &[S::F; 3], b: &[S::F; 3]) -> S::F {
    unsafe { S::fma(a[2], b[2], S::fma(a[1], b[1], S::mul(a[0], b[0]))) }
}

#[inline(always)]
unsafe fn squared<S: Simd>(d: &[S::F; 3]) -> S::F {
    unsafe { dot::<S>(d, d) }
}

#[inline(always)]
unsafe fn accumulate<S: Simd>(sums: &mut [S::F; 3], weight: S::F, values: &[S::F; 3]) {
    for (sum, value) in sums.iter_mut().zip(values) {
        *sum = unsafe { S::fma(weight, *value, *sum) };
    }
}
