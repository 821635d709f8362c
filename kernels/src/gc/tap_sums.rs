//! The sums over taps: of a row of pixels, a vector at a time, over their taps in one other row.
//!
//! Forward these are Σw, Σw y_i and Σw (x_c - x_i) for x = z, ρ, n: slopes are constant over the
//! window, so they multiply the sums, not the terms. For the gradient of the bandwidths
//! Σw d_m (u_i - g) is needed, of which g is known only at the end: Σw d_m and Σw d_m (u_i - z_c) are
//! added up for the five distances d_m, relative to z_c because that is near g.

use super::pair_logarithms::{TO_DENOISED, Tap};
use super::strip::{PITCH, Row, STRIP, at_column};
use super::vector::{accumulate, difference, load_vectors, load3, squared, store_vectors};
use crate::aligned::Aligned;
use crate::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, MAX_RADIUS, NORMAL, RADIANCE, VISIBILITY};
use crate::parameters::{BANDWIDTH_COUNT, SLOPE_COUNT};
use crate::simd::{MAX_LANES, Simd};

// The sums of one vector of pixels, in vectors from the first on.

/// Bandwidths γ, scaled for `exp2`.
pub(super) const WIDTHS: usize = 0;
/// Σw.
pub(super) const WEIGHT: usize = WIDTHS + BANDWIDTH_COUNT;
/// Σw y_i.
pub(super) const RADIANCE_SUMS: usize = WEIGHT + 1;
/// Σw (x_c - x_i) in the order of the slopes.
pub(super) const SLOPE_SUMS: usize = RADIANCE_SUMS + 3;
/// Slopes β; from here on for a gradient only.
pub(super) const SLOPE_VALUES: usize = SLOPE_SUMS + SLOPE_COUNT;
/// Σw d_m.
pub(super) const DISTANCE_SUMS: usize = SLOPE_VALUES + SLOPE_COUNT;
/// Σw d_m (u_i - z_c).
pub(super) const MOMENTS: usize = DISTANCE_SUMS + BANDWIDTH_COUNT;
const FORWARD_VECTORS: usize = SLOPE_VALUES;
const GRADIENT_VECTORS: usize = MOMENTS + 3 * BANDWIDTH_COUNT;

/// Sums of the rows whose windows are not complete, as a ring.
pub(super) struct Sums {
    data: Aligned,
    rows: usize,
    vectors: usize,
}

impl Sums {
    pub(super) fn new(radius: usize, gradient: bool) -> Self {
        Self::of_vectors(radius, if gradient { GRADIENT_VECTORS } else { FORWARD_VECTORS })
    }

    /// Room for so many sums of each vector of pixels.
    pub(super) fn of_vectors(radius: usize, vectors: usize) -> Self {
        Self { data: Aligned::zeros((radius + 1) * vectors * STRIP), rows: radius + 1, vectors }
    }

    /// Sums of the vector of pixels of row `y` that begins at column `x`.
    pub(super) fn at<S: Simd>(&mut self, y: usize, x: usize) -> &mut [f32] {
        let at = (y % self.rows * STRIP + x) * self.vectors;
        &mut self.data[at..][..self.vectors * S::LANES]
    }
}

/// What bandwidth `m` is multiplied by for `exp2` of its distance: the logarithms are to the base 2 already.
pub(super) fn exponent_unit(m: usize) -> f32 {
    if m < 3 { -std::f32::consts::LOG2_E } else { -1.0 }
}

// Per tap of a row, between the passes of a gradient: w, u_i - z_c, d_ρ, d_n, d_v.
const TERMS: usize = 7;
const TERM_U: usize = 1;
const TERM_DISTANCES: usize = 4;

/// Room for the terms of all taps of a row.
pub(super) fn tap_terms() -> Aligned {
    Aligned::zeros((2 * MAX_RADIUS + 1) * TERMS * MAX_LANES)
}

/// One vector of pixels and the row in which its taps lie.
#[derive(Clone, Copy)]
pub(super) struct TapRow<'a, S> {
    pub s: S,
    pub set: FeatureSet,
    pub masked: bool,
    /// The pixels' column.
    pub x: usize,
    /// The pixels' row.
    pub own: &'a Row,
    /// The taps' row.
    pub other: &'a Row,
    /// The logarithms from the pixels' column on.
    pub logs: &'a [f32],
}

impl<S: Simd> TapRow<'_, S> {
    /// Adds the taps to the sums.
    #[inline(always)]
    pub(super) fn add(&self, taps: &[Tap], sums: &mut [f32], weights: &mut [f32]) {
        let s = self.s;
        let sums = &mut sums[..FORWARD_VECTORS * S::LANES];
        let (centre, widths) = (self.centre(), load_vectors(s, sums, WIDTHS));
        let mut terms = Terms::load(s, sums);
        if S::REGISTERS >= 32 {
            for tap in taps {
                let (w, _) = self.weigh(tap, &centre, &widths);
                self.add_term(tap, &centre, w, &mut terms);
            }
        } else {
            // Sums and bandwidths do not fit the registers together.
            for (tap, weight) in taps.iter().zip(weights.chunks_exact_mut(S::LANES)) {
                s.store(weight, self.weigh(tap, &centre, &widths).0);
            }
            for (tap, weight) in taps.iter().zip(weights.chunks_exact(S::LANES)) {
                self.add_term(tap, &centre, s.load(weight), &mut terms);
            }
        }
        terms.store(s, sums);
    }

    /// Adds the taps' weights to Σw and keeps them, a vector for each tap.
    #[inline(always)]
    pub(super) fn add_weights(&self, taps: &[Tap], sums: &mut [f32], weights: &mut [f32]) {
        let s = self.s;
        let (centre, widths) = (self.centre(), load_vectors(s, sums, WIDTHS));
        let mut sum = s.load(&sums[WEIGHT * S::LANES..]);
        for (tap, weight) in taps.iter().zip(weights.chunks_exact_mut(S::LANES)) {
            let (w, _) = self.weigh(tap, &centre, &widths);
            sum = s.add(sum, w);
            s.store(weight, w);
        }
        s.store(&mut sums[WEIGHT * S::LANES..], sum);
    }

    /// Adds the taps to the sums, those for the gradient too. Three short passes, because one would need more
    /// registers than there are.
    #[inline(always)]
    pub(super) fn add_for_gradient(&self, taps: &[Tap], sums: &mut [f32], tap_terms: &mut [f32]) {
        let s = self.s;
        let sums = &mut sums[..GRADIENT_VECTORS * S::LANES];
        let (centre, widths) = (self.centre(), load_vectors(s, sums, WIDTHS));
        for (tap, of_tap) in taps.iter().zip(tap_terms.chunks_exact_mut(TERMS * S::LANES)) {
            let (w, distances) = self.weigh(tap, &centre, &widths);
            s.store(of_tap, w);
            store_vectors(s, of_tap, TERM_DISTANCES, distances);
        }
        let mut terms = Terms::load(s, sums);
        for (tap, of_tap) in taps.iter().zip(tap_terms.chunks_exact_mut(TERMS * S::LANES)) {
            let (y_i, differences) = self.add_term(tap, &centre, s.load(of_tap), &mut terms);
            let mut u = difference(s, &y_i, &centre.sloped[0]);
            for f in 0..3 {
                for k in 0..if self.takes_part(f) { 3 } else { 0 } {
                    let slope = s.load(&sums[(SLOPE_VALUES + 3 * f + k) * S::LANES..]);
                    u[k] = s.fma(slope, differences[f][k], u[k]);
                }
            }
            store_vectors(s, of_tap, TERM_U, u);
        }
        terms.store(s, sums);
        self.add_moments(taps, sums, tap_terms);
    }

    /// Whether the feature with these slopes (z, ρ, n) takes part.
    #[inline(always)]
    fn takes_part(&self, slopes: usize) -> bool {
        [true, self.set.albedo, self.set.normal][slopes]
    }

    /// The pixels' own features.
    #[inline(always)]
    fn centre(&self) -> Centre<S> {
        let (s, own) = (self.s, at_column::<S>(self.own, self.x as isize));
        let sloped = |f: usize| load3(s, own, SLOPED[f]);
        Centre { sloped: [sloped(0), sloped(1), sloped(2)], visibility: s.load(&own[VISIBILITY * PITCH..]) }
    }

    /// The planes of the taps' row from the tap of the first pixel on.
    #[inline(always)]
    fn at(&self, tap: &Tap) -> &[f32] {
        at_column::<S>(self.other, self.x as isize + tap.dx)
    }

    /// log2(1 + ‖y_c-y_i‖²) and log2(1 + ‖z_c-z_i‖²), where the pair's logarithms begin.
    #[inline(always)]
    fn logs(&self, tap: &Tap) -> &[f32] {
        &self.logs[tap.logs..][..TO_DENOISED + S::LANES]
    }

    /// w of a tap and its distances d_ρ, d_n, d_v.
    #[inline(always)]
    fn weigh(&self, tap: &Tap, centre: &Centre<S>, widths: &[S::F; BANDWIDTH_COUNT]) -> (S::F, [S::F; 3]) {
        let (s, at, logs) = (self.s, self.at(tap), self.logs(tap));
        let mut exponent = s.mul(widths[3], s.load(logs));
        exponent = s.fma(widths[4], s.load(&logs[TO_DENOISED..]), exponent);
        let mut distances = [s.zero(); 3];
        for f in 1..3 {
            if self.takes_part(f) {
                let d = squared(s, &difference(s, &centre.sloped[f], &load3(s, at, SLOPED[f])));
                exponent = s.fma(widths[f - 1], d, exponent);
                distances[f - 1] = d;
            }
        }
        if self.set.visibility {
            let dv = s.sub(centre.visibility, s.load(&at[VISIBILITY * PITCH..]));
            distances[2] = s.mul(dv, dv);
            exponent = s.fma(widths[2], distances[2], exponent);
        }
        let w = s.exp2(exponent);
        (if self.masked { s.mul(w, s.load(&at[FEATURE_CHANNELS * PITCH..])) } else { w }, distances)
    }

    /// Adds a tap of weight w; gives back y_i and x_c - x_i.
    #[inline(always)]
    fn add_term(&self, tap: &Tap, centre: &Centre<S>, w: S::F, terms: &mut Terms<S>) -> ([S::F; 3], [[S::F; 3]; 3]) {
        let (s, at) = (self.s, self.at(tap));
        let y_i = load3(s, at, RADIANCE);
        let mut differences = [[s.zero(); 3]; 3];
        terms.weight = s.add(terms.weight, w);
        accumulate(s, &mut terms.radiance, w, &y_i);
        for f in 0..3 {
            if self.takes_part(f) {
                differences[f] = difference(s, &centre.sloped[f], &load3(s, at, SLOPED[f]));
                accumulate(s, &mut terms.slopes[f], w, &differences[f]);
            }
        }
        (y_i, differences)
    }

    /// Σw d_m and Σw d_m (u_i - z_c) of taps whose terms are there.
    #[inline(always)]
    fn add_moments(&self, taps: &[Tap], sums: &mut [f32], tap_terms: &[f32]) {
        let s = self.s;
        let taking_part = [self.set.albedo, self.set.normal, self.set.visibility, true, true];
        let mut distances: [S::F; BANDWIDTH_COUNT] = load_vectors(s, sums, DISTANCE_SUMS);
        let mut moments = [[s.zero(); 3]; BANDWIDTH_COUNT];
        for (m, moments) in moments.iter_mut().enumerate() {
            *moments = load_vectors(s, sums, MOMENTS + 3 * m);
        }
        for (tap, of_tap) in taps.iter().zip(tap_terms.chunks_exact(TERMS * S::LANES)) {
            let logs = self.logs(tap);
            let w = s.load(of_tap);
            let u: [S::F; 3] = load_vectors(s, of_tap, TERM_U);
            for m in 0..BANDWIDTH_COUNT {
                if taking_part[m] {
                    let d = match m {
                        3 => s.load(logs),
                        4 => s.load(&logs[TO_DENOISED..]),
                        _ => s.load(&of_tap[(TERM_DISTANCES + m) * S::LANES..]),
                    };
                    let wd = s.mul(w, d);
                    distances[m] = s.add(distances[m], wd);
                    accumulate(s, &mut moments[m], wd, &u);
                }
            }
        }
        store_vectors(s, sums, DISTANCE_SUMS, distances);
        for (m, moments) in moments.into_iter().enumerate() {
            store_vectors(s, sums, MOMENTS + 3 * m, moments);
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

/// The forward sums.
struct Terms<S: Simd> {
    weight: S::F,
    radiance: [S::F; 3],
    slopes: [[S::F; 3]; 3],
}

impl<S: Simd> Terms<S> {
    #[inline(always)]
    fn load(s: S, sums: &[f32]) -> Self {
        let slopes = |f: usize| load_vectors(s, sums, SLOPE_SUMS + 3 * f);
        Self {
            weight: s.load(&sums[WEIGHT * S::LANES..]),
            radiance: load_vectors(s, sums, RADIANCE_SUMS),
            slopes: [slopes(0), slopes(1), slopes(2)],
        }
    }

    #[inline(always)]
    fn store(self, s: S, sums: &mut [f32]) {
        s.store(&mut sums[WEIGHT * S::LANES..], self.weight);
        store_vectors(s, sums, RADIANCE_SUMS, self.radiance);
        for (f, slopes) in self.slopes.into_iter().enumerate() {
            store_vectors(s, sums, SLOPE_SUMS + 3 * f, slopes);
        }
    }
}
