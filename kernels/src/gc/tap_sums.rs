//! The sums over taps: of a row of pixels, a vector at a time, over their taps in one other row.
//!
//! Forward these are Σw, Σw y_i and Σw x_i for x = z, ρ, n: slopes are constant over the window, so they multiply sums,
//! not terms: Σw β(x_c - x_i) = β (x_c Σw - Σw x_i). For the gradient of the bandwidths Σw d_m (u_i - g) is needed, of which
//! g is known only at the end: Σw d_m and Σw d_m (u_i - z_c) are added up for the five distances d_m, relative to z_c because
//! that is near g.
//!
//! Each pass over the taps keeps to the sixteen vectors that AVX2 has registers for, with one load for a value: what is in
//! memory is read as an operand of the multiply-add that needs it.

use super::pair_distances::{LENGTH, Tap};
use super::strip::{PITCH, Row, STRIP, at_column};
use super::vector::{load_vectors, load3, store_vectors};
use crate::aligned::Aligned;
use crate::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, MAX_RADIUS, NORMAL, RADIANCE};
use crate::parameters::{BANDWIDTH_COUNT, BANDWIDTHS, SLOPE_COUNT, SLOPES};
use crate::simd::{MAX_LANES, Simd};

// The sums of one vector of pixels, in vectors from the first on.

/// Bandwidths γ, scaled for `exp2`.
pub(super) const WIDTHS: usize = 0;
/// Σw.
pub(super) const WEIGHT: usize = WIDTHS + BANDWIDTH_COUNT;
/// Σw y_i.
pub(super) const RADIANCE_SUMS: usize = WEIGHT + 1;
/// Σw x_i in the order of the slopes.
pub(super) const SLOPED_SUMS: usize = RADIANCE_SUMS + 3;
/// -β; from here on for a gradient only.
const MINUS_SLOPES: usize = SLOPED_SUMS + SLOPE_COUNT;
/// What of u_i - z_c is the same for all taps: Σ β x_c - z_c.
const OFFSETS: usize = MINUS_SLOPES + SLOPE_COUNT;
/// Σw d_m.
pub(super) const DISTANCE_SUMS: usize = OFFSETS + 3;
/// Σw d_m (u_i - z_c).
pub(super) const MOMENTS: usize = DISTANCE_SUMS + BANDWIDTH_COUNT;
const FORWARD_VECTORS: usize = MINUS_SLOPES;
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

/// Sums of a vector of pixels before its first tap: 0, and what its terms are made of. Without the planes of the pixels
/// themselves only what weights are made of.
#[inline(always)]
pub(super) fn begin<S: Simd>(s: S, p: &[S::F], centre: Option<&[f32]>, sums: &mut [f32]) {
    sums.fill(0.0);
    for m in 0..BANDWIDTH_COUNT {
        // The logarithms are to the base 2 already.
        let unit = if m < 3 { -std::f32::consts::LOG2_E } else { -1.0 };
        s.store(&mut sums[(WIDTHS + m) * S::LANES..], s.mul(p[BANDWIDTHS + m], s.splat(unit)));
    }
    let Some(centre) = centre else { return };
    let z = load3(s, centre, DENOISED);
    for k in 0..3 {
        let mut offset = s.sub(s.zero(), z[k]);
        for f in 0..3 {
            let slope = p[SLOPES + 3 * f + k];
            offset = s.fma(slope, s.load(&centre[(SLOPED[f] + k) * PITCH..]), offset);
            s.store(&mut sums[(MINUS_SLOPES + 3 * f + k) * S::LANES..], s.sub(s.zero(), slope));
        }
        s.store(&mut sums[(OFFSETS + k) * S::LANES..], offset);
    }
}

/// Taps whose weights are computed at once.
const AT_ONCE: usize = 4;

/// First channels of the features that have slopes, in the order of the slopes.
pub(super) const SLOPED: [usize; 3] = [DENOISED, ALBEDO, NORMAL];

// What a pass is compiled for, so that nothing is asked for every tap: the features that most frames have, and any set.

/// Albedo, normal and visibility.
const ALL: u8 = 0;
/// Albedo and normal.
const NO_VISIBILITY: u8 = 1;
/// Those of the set.
const SOME: u8 = 2;
const NO_VISIBILITY_SET: FeatureSet = FeatureSet { visibility: false, ..FeatureSet::ALL };

/// Room for w of the taps of a vector of pixels, a vector for each tap of a row.
pub(super) fn weights() -> Aligned {
    Aligned::zeros((2 * MAX_RADIUS + 1) * MAX_LANES)
}

/// One vector of pixels and the row in which its taps lie.
#[derive(Clone, Copy)]
pub(super) struct TapRow<'a, S> {
    pub s: S,
    pub set: FeatureSet,
    pub masked: bool,
    /// The pixels' column.
    pub x: usize,
    /// The taps' row.
    pub other: &'a Row,
    /// The distances from the pixels' column on.
    pub distances: &'a [f32],
}

impl<S: Simd> TapRow<'_, S> {
    /// Adds the taps to the sums.
    #[inline(always)]
    pub(super) fn add(&self, taps: &[Tap], sums: &mut [f32], weights: &mut [f32]) {
        self.add_weights(taps, sums, weights);
        match (self.set.albedo, self.set.normal) {
            (true, true) => self.add_values::<ALL>(taps, sums, weights),
            _ => self.add_values::<SOME>(taps, sums, weights),
        }
    }

    /// Adds the taps to the sums, those for the gradient too.
    #[inline(always)]
    pub(super) fn add_for_gradient(&self, taps: &[Tap], sums: &mut [f32], weights: &mut [f32]) {
        self.weigh::<true>(taps, sums, weights);
        match self.set {
            FeatureSet::ALL => self.add_moments::<ALL>(taps, sums, weights),
            NO_VISIBILITY_SET => self.add_moments::<NO_VISIBILITY>(taps, sums, weights),
            _ => self.add_moments::<SOME>(taps, sums, weights),
        }
    }

    /// Adds the taps' weights to Σw and keeps them.
    #[inline(always)]
    pub(super) fn add_weights(&self, taps: &[Tap], sums: &mut [f32], weights: &mut [f32]) {
        self.weigh::<false>(taps, sums, weights);
    }

    /// The same, and Σw d_m for a gradient.
    #[inline(always)]
    fn weigh<const GRADIENT: bool>(&self, taps: &[Tap], sums: &mut [f32], weights: &mut [f32]) {
        match self.set {
            FeatureSet::ALL => self.weigh_with::<ALL, GRADIENT>(taps, sums, weights),
            NO_VISIBILITY_SET => self.weigh_with::<NO_VISIBILITY, GRADIENT>(taps, sums, weights),
            _ => self.weigh_with::<SOME, GRADIENT>(taps, sums, weights),
        }
    }

    /// Whether y, z, ρ and n take part.
    #[inline(always)]
    fn values_take_part<const FEATURES: u8>(&self) -> [bool; VALUES.len()] {
        match FEATURES {
            SOME => [true, true, self.set.albedo, self.set.normal],
            _ => [true; VALUES.len()],
        }
    }

    /// Whether the distances of ρ, n, v, y and z take part.
    #[inline(always)]
    fn distances_take_part<const FEATURES: u8>(&self) -> [bool; BANDWIDTH_COUNT] {
        match FEATURES {
            ALL => [true; BANDWIDTH_COUNT],
            NO_VISIBILITY => [true, true, false, true, true],
            _ => [self.set.albedo, self.set.normal, self.set.visibility, true, true],
        }
    }

    /// The planes of the taps' row from the tap of the first pixel on.
    #[inline(always)]
    fn at(&self, tap: &Tap) -> &[f32] {
        at_column::<S>(self.other, self.x as isize + tap.dx)
    }

    /// The distances of a tap from the first of the pixels on.
    #[inline(always)]
    fn distances(&self, tap: &Tap) -> &[f32] {
        &self.distances[tap.distances..][..(BANDWIDTH_COUNT - 1) * LENGTH + S::LANES]
    }

    #[inline(always)]
    fn weigh_with<const FEATURES: u8, const GRADIENT: bool>(
        &self,
        taps: &[Tap],
        sums: &mut [f32],
        weights: &mut [f32],
    ) {
        let s = self.s;
        let widths: [S::F; BANDWIDTH_COUNT] = load_vectors(s, sums, WIDTHS);
        let mut sum = s.load(&sums[WEIGHT * S::LANES..]);
        let mut of_distances = [s.zero(); BANDWIDTH_COUNT];
        if GRADIENT {
            of_distances = load_vectors(s, sums, DISTANCE_SUMS);
        }
        let totals = (&mut sum, &mut of_distances);
        let (several, rest) = taps.as_chunks::<AT_ONCE>();
        let (of_several, of_rest) = weights.split_at_mut(several.len() * AT_ONCE * S::LANES);
        for (taps, weights) in several.iter().zip(of_several.chunks_exact_mut(AT_ONCE * S::LANES)) {
            self.weigh_each::<FEATURES, GRADIENT, AT_ONCE>(taps, &widths, (&mut *totals.0, &mut *totals.1), weights);
        }
        match *rest {
            [a, b, c] => self.weigh_each::<FEATURES, GRADIENT, 3>(&[a, b, c], &widths, totals, of_rest),
            [a, b] => self.weigh_each::<FEATURES, GRADIENT, 2>(&[a, b], &widths, totals, of_rest),
            [a] => self.weigh_each::<FEATURES, GRADIENT, 1>(&[a], &widths, totals, of_rest),
            _ => (),
        }
        s.store(&mut sums[WEIGHT * S::LANES..], sum);
        if GRADIENT {
            store_vectors(s, sums, DISTANCE_SUMS, of_distances);
        }
    }

    /// The weights of `N` taps, added to Σw and Σw d_m and kept.
    #[inline(always)]
    fn weigh_each<const FEATURES: u8, const GRADIENT: bool, const N: usize>(
        &self,
        taps: &[Tap; N],
        widths: &[S::F; BANDWIDTH_COUNT],
        (sum, of_distances): (&mut S::F, &mut [S::F; BANDWIDTH_COUNT]),
        weights: &mut [f32],
    ) {
        let (s, takes_part) = (self.s, self.distances_take_part::<FEATURES>());
        let mut exponents = [s.zero(); N];
        for (tap, exponent) in taps.iter().zip(&mut exponents) {
            let d = self.distances(tap);
            *exponent = s.mul(widths[BANDWIDTH_COUNT - 1], s.load(&d[(BANDWIDTH_COUNT - 1) * LENGTH..]));
            for m in 0..BANDWIDTH_COUNT - 1 {
                if takes_part[m] {
                    *exponent = s.fma(widths[m], s.load(&d[m * LENGTH..]), *exponent);
                }
            }
        }
        let mut w = s.exp2_each(exponents);
        for (tap, w) in taps.iter().zip(&mut w) {
            if self.masked {
                *w = s.mul(*w, s.load(&self.at(tap)[FEATURE_CHANNELS * PITCH..]));
            }
            *sum = s.add(*sum, *w);
        }
        store_vectors(s, weights, 0, w);
        for (tap, w) in taps.iter().zip(w).take(if GRADIENT { N } else { 0 }) {
            let d = self.distances(tap);
            for m in 0..BANDWIDTH_COUNT {
                if takes_part[m] {
                    of_distances[m] = s.fma(w, s.load(&d[m * LENGTH..]), of_distances[m]);
                }
            }
        }
    }

    /// Adds Σw y_i and Σw x_i of taps whose weights are there.
    #[inline(always)]
    fn add_values<const FEATURES: u8>(&self, taps: &[Tap], sums: &mut [f32], weights: &[f32]) {
        let (s, takes_part) = (self.s, self.values_take_part::<FEATURES>());
        let mut terms = [[s.zero(); 3]; VALUES.len()];
        for (f, terms) in terms.iter_mut().enumerate() {
            *terms = load_vectors(s, sums, RADIANCE_SUMS + 3 * f);
        }
        for (tap, weight) in taps.iter().zip(weights.chunks_exact(S::LANES)) {
            let (w, at) = (s.load(weight), self.at(tap));
            for (f, terms) in terms.iter_mut().enumerate() {
                if takes_part[f] {
                    for (k, term) in terms.iter_mut().enumerate() {
                        *term = s.fma(w, s.load(&at[(VALUES[f] + k) * PITCH..]), *term);
                    }
                }
            }
        }
        for (f, terms) in terms.into_iter().enumerate() {
            store_vectors(s, sums, RADIANCE_SUMS + 3 * f, terms);
        }
    }

    /// The same, and Σw d_m (u_i - z_c), channel by channel.
    #[inline(always)]
    fn add_moments<const FEATURES: u8>(&self, taps: &[Tap], sums: &mut [f32], weights: &[f32]) {
        let s = self.s;
        let distances_take_part = self.distances_take_part::<FEATURES>();
        let [_, sloped_take_part @ ..] = self.values_take_part::<FEATURES>();
        for k in 0..3 {
            let sum_of = |f: usize| (SLOPED_SUMS + 3 * f + k) * S::LANES;
            let moment_of = |m: usize| (MOMENTS + 3 * m + k) * S::LANES;
            let mut radiance = s.load(&sums[(RADIANCE_SUMS + k) * S::LANES..]);
            let mut sloped = [s.zero(); 3];
            let mut minus_slopes = [s.zero(); 3];
            for f in 0..3 {
                sloped[f] = s.load(&sums[sum_of(f)..]);
                minus_slopes[f] = s.load(&sums[(MINUS_SLOPES + 3 * f + k) * S::LANES..]);
            }
            let mut moments = [s.zero(); BANDWIDTH_COUNT];
            for (m, moment) in moments.iter_mut().enumerate() {
                *moment = s.load(&sums[moment_of(m)..]);
            }
            let offset = s.load(&sums[(OFFSETS + k) * S::LANES..]);
            for (tap, weight) in taps.iter().zip(weights.chunks_exact(S::LANES)) {
                let (w, at, d) = (s.load(weight), self.at(tap), self.distances(tap));
                let y_i = s.load(&at[(RADIANCE + k) * PITCH..]);
                radiance = s.fma(w, y_i, radiance);
                let mut u = s.add(y_i, offset);
                for f in 0..3 {
                    if sloped_take_part[f] {
                        let x_i = s.load(&at[(SLOPED[f] + k) * PITCH..]);
                        sloped[f] = s.fma(w, x_i, sloped[f]);
                        u = s.fma(minus_slopes[f], x_i, u);
                    }
                }
                let wu = s.mul(w, u);
                for m in 0..BANDWIDTH_COUNT {
                    if distances_take_part[m] {
                        moments[m] = s.fma(s.load(&d[m * LENGTH..]), wu, moments[m]);
                    }
                }
            }
            s.store(&mut sums[(RADIANCE_SUMS + k) * S::LANES..], radiance);
            for f in 0..3 {
                s.store(&mut sums[sum_of(f)..], sloped[f]);
            }
            for m in 0..BANDWIDTH_COUNT {
                s.store(&mut sums[moment_of(m)..], moments[m]);
            }
        }
    }
}

/// First channels of what is averaged: y, and what has slopes.
const VALUES: [usize; 4] = [RADIANCE, DENOISED, ALBEDO, NORMAL];
