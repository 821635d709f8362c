//! The sums over taps: of a row of pixels, a vector at a time, over their taps in one other row.
//!
//! Forward these are Σw, Σw y_i and Σw (x_c - x_i) for x = z, ρ, n: slopes are constant over the
//! window, so they multiply the sums, not the terms. (x_c Σw - Σw x_i would be cheaper, but the small difference of large sums is
//! noise in dark places.) For the gradient of the bandwidths
//! Σw d_m (u_i - g) is needed, of which g is known only at the end: Σw d_m and Σw d_m (u_i - z_c) are
//! added up for the five distances d_m, relative to z_c because that is near g. All sums are [`SCALE`] times these.
//!
//! Several passes over the taps of a row, one for the weights, one for each channel and those of the gradient, keep to the
//! registers that there are. Each row's taps are added up by themselves first: sums of some twenty values, and then of some
//! twenty rows, lose less than of four hundred in a row.

use super::pair_distances::{LENGTH, Tap};
use super::strip::{PITCH, Row, STRIP, at_column};
use super::vector::{add_vectors, load_vectors, store_vectors};
use crate::aligned::Aligned;
use crate::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, MAX_RADIUS, NORMAL, RADIANCE};
use crate::parameters::{BANDWIDTH_COUNT, BANDWIDTHS, SLOPE_COUNT, SLOPES};
use crate::simd::{Exp2, MAX_LANES, Simd};

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
const SLOPE_VALUES: usize = SLOPE_SUMS + SLOPE_COUNT;
/// Σ d_m v of every distance d_m, with each value v that is [`KEPT`] of a tap: Σw d_m and Σw d_m (u_i - z_c).
pub(super) const MOMENTS: usize = SLOPE_VALUES + SLOPE_COUNT;
const FORWARD_VECTORS: usize = SLOPE_VALUES;
const GRADIENT_VECTORS: usize = MOMENTS + KEPT * BANDWIDTH_COUNT;

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

/// Sums of a vector of pixels before its first tap: 0, and what its terms are made of: for weights alone the widths, for a
/// gradient the slopes too.
#[inline(always)]
pub(super) fn begin<S: Simd>(s: S, p: &[S::F], gradient: bool, sums: &mut [f32]) {
    sums.fill(0.0);
    for m in 0..BANDWIDTH_COUNT {
        // The logarithms are to the base 2 already.
        let unit = if m < 3 { -std::f32::consts::LOG2_E } else { -1.0 };
        s.store(&mut sums[(WIDTHS + m) * S::LANES..], s.mul(p[BANDWIDTHS + m], s.splat(unit)));
    }
    for i in 0..if gradient { SLOPE_COUNT } else { 0 } {
        s.store(&mut sums[(SLOPE_VALUES + i) * S::LANES..], p[SLOPES + i]);
    }
}

/// Taps whose weights are computed at once.
const AT_ONCE: usize = 4;

/// Weights and all their sums are multiplied by this, and less than 2^-126 is 0. Else those beyond an edge of the picture would be so
/// small that their sums are subnormal, and for those Intel's processors take a hundred times as long. No more than this: 625 terms
/// w d_m u of the largest radiance, 1e15, and the largest features, 1e4, stay below 2^127.
pub(super) const SCALE: f32 = (1_u64 << 32) as f32;
/// [`SCALE`] 2^r.
const SCALED: Exp2 = Exp2::times(SCALE);
/// Least exponent of a weight, and what is taken off every weight, so that this one is 0.
const FAINTEST: f32 = -126.0;
const FAINTEST_WEIGHT: f32 = SCALE * f32::MIN_POSITIVE;

/// First channels of the features that have slopes, in the order of the slopes.
const SLOPED: [usize; 3] = [DENOISED, ALBEDO, NORMAL];

// What a pass is compiled for, so that nothing is asked for every tap: the features that most frames have, and any set.

/// Albedo, normal and visibility.
const ALL: u8 = 0;
/// Albedo and normal.
const NO_VISIBILITY: u8 = 1;
/// Those of the set.
const SOME: u8 = 2;
const NO_VISIBILITY_SET: FeatureSet = FeatureSet { visibility: false, ..FeatureSet::ALL };

/// What is kept of each tap of a vector of pixels: w, and for a gradient w (u_i - z_c) of every channel.
pub(super) const KEPT: usize = 4;
/// Floats of one of these of all taps of a row, a vector each.
const OF_TAPS: usize = (2 * MAX_RADIUS + 1) * MAX_LANES;

/// Room for what is kept of a row's taps.
pub(super) fn tap_values() -> Aligned {
    Aligned::zeros(KEPT * OF_TAPS)
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
    /// The distances from the pixels' column on.
    pub distances: &'a [f32],
}

impl<S: Simd> TapRow<'_, S> {
    /// Adds the taps to the sums.
    #[inline(always)]
    pub(super) fn add(&self, taps: &[Tap], sums: &mut [f32], values: &mut [f32]) {
        self.add_weights(taps, sums, values);
        self.add_values::<false>(taps, sums, values);
    }

    /// Adds the taps to the sums, those for the gradient too.
    #[inline(always)]
    pub(super) fn add_for_gradient(&self, taps: &[Tap], sums: &mut [f32], values: &mut [f32]) {
        self.add_weights(taps, sums, values);
        self.add_values::<true>(taps, sums, values);
        match self.set {
            FeatureSet::ALL => self.add_moments::<ALL>(taps, sums, values),
            NO_VISIBILITY_SET => self.add_moments::<NO_VISIBILITY>(taps, sums, values),
            _ => self.add_moments::<SOME>(taps, sums, values),
        }
    }

    /// Adds the taps' weights to Σw and keeps them, as the first of `values`.
    #[inline(always)]
    pub(super) fn add_weights(&self, taps: &[Tap], sums: &mut [f32], values: &mut [f32]) {
        match self.set {
            FeatureSet::ALL => self.weigh::<ALL>(taps, sums, values),
            NO_VISIBILITY_SET => self.weigh::<NO_VISIBILITY>(taps, sums, values),
            _ => self.weigh::<SOME>(taps, sums, values),
        }
    }

    /// Adds Σw y_i and Σw (x_c - x_i) of taps whose weights are there. For a gradient w (u_i - z_c) is kept too.
    #[inline(always)]
    fn add_values<const GRADIENT: bool>(&self, taps: &[Tap], sums: &mut [f32], values: &mut [f32]) {
        for k in 0..3 {
            match (self.set.albedo, self.set.normal) {
                (true, true) => self.add_channel::<ALL, GRADIENT>(k, taps, sums, values),
                _ => self.add_channel::<SOME, GRADIENT>(k, taps, sums, values),
            }
        }
    }

    /// Whether z, ρ and n take part.
    #[inline(always)]
    fn slopes_take_part<const FEATURES: u8>(&self) -> [bool; 3] {
        match FEATURES {
            SOME => [true, self.set.albedo, self.set.normal],
            _ => [true; 3],
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
    fn weigh<const FEATURES: u8>(&self, taps: &[Tap], sums: &mut [f32], weights: &mut [f32]) {
        let s = self.s;
        let widths: [S::F; BANDWIDTH_COUNT] = load_vectors(s, sums, WIDTHS);
        let mut sum = s.zero();
        let (several, rest) = taps.as_chunks::<AT_ONCE>();
        let (of_several, of_rest) = weights.split_at_mut(several.len() * AT_ONCE * S::LANES);
        for (taps, weights) in several.iter().zip(of_several.chunks_exact_mut(AT_ONCE * S::LANES)) {
            self.weigh_each::<FEATURES, AT_ONCE>(taps, &widths, &mut sum, weights);
        }
        match *rest {
            [a, b, c] => self.weigh_each::<FEATURES, 3>(&[a, b, c], &widths, &mut sum, of_rest),
            [a, b] => self.weigh_each::<FEATURES, 2>(&[a, b], &widths, &mut sum, of_rest),
            [a] => self.weigh_each::<FEATURES, 1>(&[a], &widths, &mut sum, of_rest),
            _ => (),
        }
        add_vectors(s, sums, WEIGHT, [sum]);
    }

    /// The weights of `N` taps, added to Σw and kept.
    #[inline(always)]
    fn weigh_each<const FEATURES: u8, const N: usize>(
        &self,
        taps: &[Tap; N],
        widths: &[S::F; BANDWIDTH_COUNT],
        sum: &mut S::F,
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
        let faintest = s.splat(FAINTEST);
        for exponent in &mut exponents {
            *exponent = s.max(*exponent, faintest);
        }
        let mut w = s.exp2_each(&SCALED, exponents);
        for (tap, w) in taps.iter().zip(&mut w) {
            *w = s.sub(*w, s.splat(FAINTEST_WEIGHT));
            if self.masked {
                *w = s.mul(*w, s.load(&self.at(tap)[FEATURE_CHANNELS * PITCH..]));
            }
            *sum = s.add(*sum, *w);
        }
        store_vectors(s, weights, 0, w);
    }

    /// Channel `k` of these sums.
    #[inline(always)]
    fn add_channel<const FEATURES: u8, const GRADIENT: bool>(
        &self,
        k: usize,
        taps: &[Tap],
        sums: &mut [f32],
        values: &mut [f32],
    ) {
        let (s, takes_part) = (self.s, self.slopes_take_part::<FEATURES>());
        let (centre, mut slope_values) = (self.centre(k), [s.zero(); 3]);
        if GRADIENT {
            for (f, value) in slope_values.iter_mut().enumerate() {
                *value = s.load(&sums[(SLOPE_VALUES + 3 * f + k) * S::LANES..]);
            }
        }
        let (mut radiance, mut slopes) = (s.zero(), [s.zero(); 3]);
        let (weights, rest) = values.split_at_mut(OF_TAPS);
        let kept = rest[k * OF_TAPS..].chunks_exact_mut(S::LANES);
        for ((tap, weight), kept) in taps.iter().zip(weights.chunks_exact(S::LANES)).zip(kept) {
            let (w, at) = (s.load(weight), self.at(tap));
            let y_i = s.load(&at[(RADIANCE + k) * PITCH..]);
            radiance = s.fma(w, y_i, radiance);
            let mut u = s.sub(y_i, centre[0]);
            for f in 0..3 {
                if takes_part[f] {
                    let difference = s.sub(centre[f], s.load(&at[(SLOPED[f] + k) * PITCH..]));
                    slopes[f] = s.fma(w, difference, slopes[f]);
                    u = s.fma(slope_values[f], difference, u);
                }
            }
            if GRADIENT {
                s.store(kept, s.mul(w, u));
            }
        }
        add_vectors(s, sums, RADIANCE_SUMS + k, [radiance]);
        for (f, sum) in slopes.into_iter().enumerate() {
            add_vectors(s, sums, SLOPE_SUMS + 3 * f + k, [sum]);
        }
    }

    /// Adds Σ d_m v of the values that were kept for the taps, v = w and w (u_i - z_c).
    #[inline(always)]
    fn add_moments<const FEATURES: u8>(&self, taps: &[Tap], sums: &mut [f32], values: &[f32]) {
        if S::REGISTERS >= 32 {
            self.add_moments_of::<FEATURES, KEPT>(0, taps, sums, values);
        } else {
            self.add_moments_of::<FEATURES, 2>(0, taps, sums, values);
            self.add_moments_of::<FEATURES, 2>(2, taps, sums, values);
        }
    }

    /// Of `N` values from `first` on: as many as there are registers for the sums.
    #[inline(always)]
    fn add_moments_of<const FEATURES: u8, const N: usize>(
        &self,
        first: usize,
        taps: &[Tap],
        sums: &mut [f32],
        values: &[f32],
    ) {
        let (s, takes_part) = (self.s, self.distances_take_part::<FEATURES>());
        let mut moments = [[s.zero(); N]; BANDWIDTH_COUNT];
        let values = &values[first * OF_TAPS..][..(N - 1) * OF_TAPS + taps.len() * S::LANES];
        for (i, tap) in taps.iter().enumerate() {
            let distances = self.distances(tap);
            let mut of_tap = [s.zero(); N];
            for (v, value) in of_tap.iter_mut().enumerate() {
                *value = s.load(&values[v * OF_TAPS + i * S::LANES..]);
            }
            for m in 0..BANDWIDTH_COUNT {
                if takes_part[m] {
                    let d = s.load(&distances[m * LENGTH..]);
                    for v in 0..N {
                        moments[m][v] = s.fma(d, of_tap[v], moments[m][v]);
                    }
                }
            }
        }
        for (m, moments) in moments.into_iter().enumerate() {
            add_vectors(s, sums, MOMENTS + KEPT * m + first, moments);
        }
    }

    /// z, ρ and n of the pixels themselves in channel `k`.
    #[inline(always)]
    fn centre(&self, k: usize) -> [S::F; 3] {
        let (s, own) = (self.s, at_column::<S>(self.own, self.x as isize));
        let plane = |f: usize| s.load(&own[(SLOPED[f] + k) * PITCH..]);
        [plane(0), plane(1), plane(2)]
    }
}
