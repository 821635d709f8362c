//! The sums over taps: of a row of pixels, a vector at a time, over their taps in one other row.
//!
//! Forward these are Σw, Σw y_i and Σw (x_c - x_i) for x = z, ρ, n: slopes are constant over the
//! window, so they multiply the sums, not the terms. For the gradient of the bandwidths
//! Σw d_m (u_i - g) is needed, of which g is known only at the end: Σw d_m and Σw d_m (u_i - z_c) are
//! added up for the five distances d_m, relative to z_c because that is near g.

use super::pairs::{TO_DENOISED, Tap};
use super::strip::{Line, PITCH, STRIP, lines};
use super::vector::{accumulate, difference, load3, squared, store_vectors, vectors};
use crate::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, MAX_RADIUS, NORMAL, RADIANCE, VISIBILITY};
use crate::parameters::{BANDWIDTH_COUNT, SLOPE_COUNT};
use crate::simd::{MAX_LANES, Simd};

/// What a sum holds for one vector of pixels, in vectors: bandwidths, scaled for `exp2`,
pub(super) const WIDTHS: usize = 0;
/// Σw,
pub(super) const WEIGHT: usize = WIDTHS + BANDWIDTH_COUNT;
/// Σw y_i,
pub(super) const RADIANCE_SUMS: usize = WEIGHT + 1;
/// Σw (x_c - x_i) in the order of the slopes;
pub(super) const SLOPE_SUMS: usize = RADIANCE_SUMS + 3;
/// for a gradient also the slopes,
pub(super) const SLOPE_VALUES: usize = SLOPE_SUMS + SLOPE_COUNT;
/// Σw d_m,
pub(super) const DISTANCE_SUMS: usize = SLOPE_VALUES + SLOPE_COUNT;
/// Σw d_m (u_i - z_c).
pub(super) const MOMENTS: usize = DISTANCE_SUMS + BANDWIDTH_COUNT;
const FORWARD_VECTORS: usize = SLOPE_VALUES;
const GRADIENT_VECTORS: usize = MOMENTS + 3 * BANDWIDTH_COUNT;

/// Sums of the rows whose windows are not complete, as a ring.
pub(super) struct Sums {
    data: Vec<Line>,
    rows: usize,
    vectors: usize,
}

impl Sums {
    pub(super) fn new(radius: usize, gradient: bool) -> Self {
        let vectors = if gradient { GRADIENT_VECTORS } else { FORWARD_VECTORS };
        Self { data: lines((radius + 1) * vectors * STRIP), rows: radius + 1, vectors }
    }

    /// Vectors of one vector of pixels.
    pub(super) fn vectors(&self) -> usize {
        self.vectors
    }

    /// Sums of the vector of pixels of row `y` that begins at column `x`.
    pub(super) fn at(&mut self, y: usize, x: usize) -> *mut f32 {
        let at = (y % self.rows * STRIP + x) * self.vectors;
        self.data.as_mut_ptr().cast::<f32>().wrapping_add(at)
    }
}

/// Per tap of a row, between the sweeps of a gradient: w, u_i - z_c, d_ρ, d_n, d_v.
const KEPT: usize = 7;
const KEPT_U: usize = 1;
const KEPT_DISTANCES: usize = 4;

pub(super) fn kept() -> Vec<Line> {
    lines((2 * MAX_RADIUS + 1) * KEPT * MAX_LANES)
}

/// One vector of pixels and the row in which its taps lie.
#[derive(Clone, Copy)]
pub(super) struct Sweep {
    pub set: FeatureSet,
    pub masked: bool,
    /// First plane at the pixels.
    pub centre: *const f32,
    /// First plane in the taps' row, at the pixels' column.
    pub row: *const f32,
    /// The logarithms that belong to the pixels' column.
    pub logs: *const f32,
    pub sums: *mut f32,
    pub kept: *mut f32,
}

impl Sweep {
    /// Adds the taps to the sums.
    ///
    /// # Safety
    /// The machine must have `S`; the pointers must lead to rows, logarithms and sums that hold what
    /// the taps reach, `kept` to the result of [`kept`].
    #[inline(always)]
    pub(super) unsafe fn add<S: Simd>(&self, taps: &[Tap]) {
        unsafe {
            let (centre, widths) = (Centre::<S>::load(self.centre), vectors::<S, 5>(self.sums, WIDTHS));
            let mut terms = Terms::<S>::load(self.sums);
            if S::REGISTERS >= 32 {
                for tap in taps {
                    let (w, _) = self.weigh::<S>(tap, &centre, &widths);
                    self.add_term::<S>(tap, &centre, w, &mut terms);
                }
            } else {
                // Sums and bandwidths do not fit the registers together.
                for (t, tap) in taps.iter().enumerate() {
                    S::store(self.kept.add(t * S::LANES), self.weigh::<S>(tap, &centre, &widths).0);
                }
                for (t, tap) in taps.iter().enumerate() {
                    self.add_term::<S>(tap, &centre, S::load(self.kept.add(t * S::LANES)), &mut terms);
                }
            }
            terms.store(self.sums);
        }
    }

    /// The same, and the sums for the gradient. Three short sweeps, because one would need more
    /// registers than there are.
    ///
    /// # Safety
    /// As [`Self::add`]; the sums must be those of a gradient.
    #[inline(always)]
    pub(super) unsafe fn add_for_gradient<S: Simd>(&self, taps: &[Tap]) {
        unsafe {
            let (centre, widths) = (Centre::<S>::load(self.centre), vectors::<S, 5>(self.sums, WIDTHS));
            for (t, tap) in taps.iter().enumerate() {
                let (w, distances) = self.weigh::<S>(tap, &centre, &widths);
                let keep = self.kept.add(t * KEPT * S::LANES);
                S::store(keep, w);
                store_vectors::<S, 3>(keep, KEPT_DISTANCES, distances);
            }
            let mut terms = Terms::<S>::load(self.sums);
            for (t, tap) in taps.iter().enumerate() {
                let keep = self.kept.add(t * KEPT * S::LANES);
                let (y_i, differences) = self.add_term::<S>(tap, &centre, S::load(keep), &mut terms);
                let mut u = difference::<S>(&y_i, &centre.sloped[0]);
                for f in 0..3 {
                    for k in 0..if self.takes_part(f) { 3 } else { 0 } {
                        let slope = S::load(self.sums.add((SLOPE_VALUES + 3 * f + k) * S::LANES));
                        u[k] = S::fma(slope, differences[f][k], u[k]);
                    }
                }
                store_vectors::<S, 3>(keep, KEPT_U, u);
            }
            terms.store(self.sums);
            self.add_moments::<S>(taps);
        }
    }

    /// Whether the feature with these slopes (z, ρ, n) takes part.
    #[inline(always)]
    fn takes_part(&self, slopes: usize) -> bool {
        [true, self.set.albedo, self.set.normal][slopes]
    }

    /// w of a tap and its distances d_ρ, d_n, d_v.
    #[inline(always)]
    unsafe fn weigh<S: Simd>(&self, tap: &Tap, centre: &Centre<S>, widths: &[S::F; 5]) -> (S::F, [S::F; 3]) {
        unsafe {
            let (at, logs) = (self.row.offset(tap.dx), self.logs.add(tap.logs));
            let mut exponent = S::mul(widths[3], S::load(logs));
            exponent = S::fma(widths[4], S::load(logs.add(TO_DENOISED)), exponent);
            let mut distances = [S::zero(); 3];
            for f in 1..3 {
                if self.takes_part(f) {
                    let d = squared::<S>(&difference::<S>(&centre.sloped[f], &load3::<S>(at.add(SLOPED[f] * PITCH))));
                    exponent = S::fma(widths[f - 1], d, exponent);
                    distances[f - 1] = d;
                }
            }
            if self.set.visibility {
                let dv = S::sub(centre.visibility, S::load(at.add(VISIBILITY * PITCH)));
                distances[2] = S::mul(dv, dv);
                exponent = S::fma(widths[2], distances[2], exponent);
            }
            let w = S::exp2(exponent);
            (if self.masked { S::mul(w, S::load(at.add(FEATURE_CHANNELS * PITCH))) } else { w }, distances)
        }
    }

    /// Adds a tap of weight w; gives back y_i and x_c - x_i.
    #[inline(always)]
    unsafe fn add_term<S: Simd>(
        &self,
        tap: &Tap,
        centre: &Centre<S>,
        w: S::F,
        terms: &mut Terms<S>,
    ) -> ([S::F; 3], [[S::F; 3]; 3]) {
        unsafe {
            let at = self.row.offset(tap.dx);
            let y_i = load3::<S>(at.add(RADIANCE * PITCH));
            let mut differences = [[S::zero(); 3]; 3];
            terms.weight = S::add(terms.weight, w);
            accumulate::<S>(&mut terms.radiance, w, &y_i);
            for f in 0..3 {
                if self.takes_part(f) {
                    differences[f] = difference::<S>(&centre.sloped[f], &load3::<S>(at.add(SLOPED[f] * PITCH)));
                    accumulate::<S>(&mut terms.slopes[f], w, &differences[f]);
                }
            }
            (y_i, differences)
        }
    }

    #[inline(always)]
    unsafe fn add_moments<S: Simd>(&self, taps: &[Tap]) {
        unsafe {
            let taking_part = [self.set.albedo, self.set.normal, self.set.visibility, true, true];
            let mut distances: [S::F; 5] = vectors::<S, 5>(self.sums, DISTANCE_SUMS);
            let mut moments: [[S::F; 3]; 5] = std::array::from_fn(|m| vectors::<S, 3>(self.sums, MOMENTS + 3 * m));
            for (t, tap) in taps.iter().enumerate() {
                let keep = self.kept.add(t * KEPT * S::LANES);
                let logs = self.logs.add(tap.logs);
                let w = S::load(keep);
                let u: [S::F; 3] = vectors::<S, 3>(keep, KEPT_U);
                for m in 0..5 {
                    if taking_part[m] {
                        let d = match m {
                            3 => S::load(logs),
                            4 => S::load(logs.add(TO_DENOISED)),
                            _ => S::load(keep.add((KEPT_DISTANCES + m) * S::LANES)),
                        };
                        let wd = S::mul(w, d);
                        distances[m] = S::add(distances[m], wd);
                        accumulate::<S>(&mut moments[m], wd, &u);
                    }
                }
            }
            store_vectors::<S, 5>(self.sums, DISTANCE_SUMS, distances);
            for (m, moments) in moments.into_iter().enumerate() {
                store_vectors::<S, 3>(self.sums, MOMENTS + 3 * m, moments);
            }
        }
    }
}

/// First channels of the features that have slopes, in the order of the slopes.
const SLOPED: [usize; 3] = [DENOISED, ALBEDO, NORMAL];

/// Features of the pixels themselves.
struct Centre<S: Simd> {
    sloped: [[S::F; 3]; 3],
    visibility: S::F,
}

impl<S: Simd> Centre<S> {
    #[inline(always)]
    unsafe fn load(at: *const f32) -> Self {
        unsafe {
            let sloped = |f: usize| load3::<S>(at.add(SLOPED[f] * PITCH));
            Self { sloped: [sloped(0), sloped(1), sloped(2)], visibility: S::load(at.add(VISIBILITY * PITCH)) }
        }
    }
}

/// The forward sums.
struct Terms<S: Simd> {
    weight: S::F,
    radiance: [S::F; 3],
    slopes: [[S::F; 3]; 3],
}

impl<S: Simd> Terms<S> {
    #[inline(always)]
    unsafe fn load(sums: *const f32) -> Self {
        unsafe {
            let slopes = |f: usize| vectors::<S, 3>(sums, SLOPE_SUMS + 3 * f);
            Self {
                weight: S::load(sums.add(WEIGHT * S::LANES)),
                radiance: vectors::<S, 3>(sums, RADIANCE_SUMS),
                slopes: [slopes(0), slopes(1), slopes(2)],
            }
        }
    }

    #[inline(always)]
    unsafe fn store(self, sums: *mut f32) {
        unsafe {
            S::store(sums.add(WEIGHT * S::LANES), self.weight);
            store_vectors::<S, 3>(sums, RADIANCE_SUMS, self.radiance);
            for (f, slopes) in self.slopes.into_iter().enumerate() {
                store_vectors::<S, 3>(sums, SLOPE_SUMS + 3 * f, slopes);
            }
        }
    }
}
