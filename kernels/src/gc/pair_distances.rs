//! What a pixel and its tap have in common: the five distances d_m of Eq. 11, most of the arithmetic of a weight. They are
//! computed once for both pixels of a pair.

use super::strip::{PITCH, Row, STRIP, at_columns};
use super::taps::{Pair, RowPairs};
use super::vector::{difference, load3, squared, store_vectors};
use crate::aligned::Aligned;
use crate::features::{ALBEDO, DENOISED, FeatureSet, MAX_RADIUS, NORMAL, RADIANCE, VISIBILITY};
use crate::parameters::BANDWIDTH_COUNT;
use crate::simd::{MAX_LANES, Simd};
use std::ops::Range;

/// Floats of one distance of one pair's dx.
pub(super) const LENGTH: usize = (STRIP + MAX_RADIUS + MAX_LANES).next_multiple_of(MAX_LANES);
const OF_PAIR: usize = BANDWIDTH_COUNT * LENGTH;
/// Vectors whose logarithms are computed at once.
const AT_ONCE: usize = 4;

/// One tap of all pixels of a row, and where its distances lie for the pixel in column 0.
#[derive(Clone, Copy)]
pub(super) struct Tap {
    pub dx: isize,
    pub distances: usize,
}

/// The taps of two rows of pixels in one another.
pub(super) struct RowTaps {
    pub dy: isize,
    pairs: Vec<Pair>,
    /// Taps in the lower row of pixels in the upper one.
    pub down: Vec<Tap>,
    /// Taps in the upper row of pixels in the lower one.
    pub up: Vec<Tap>,
}

impl RowTaps {
    pub(super) fn new(row: RowPairs) -> Self {
        let distances = |i: usize, skipped: isize| i * OF_PAIR + skipped.max(0) as usize;
        let pairs = || row.pairs.iter().enumerate();
        let down = |(i, p): (usize, &Pair)| Tap { dx: p.dx, distances: distances(i, p.dx) };
        let up = |(i, p): (usize, &Pair)| Tap { dx: -p.dx, distances: distances(i, -p.dx) };
        Self {
            dy: row.dy,
            down: pairs().filter(|(_, p)| p.down).map(down).collect(),
            up: pairs().filter(|(_, p)| p.up).map(up).collect(),
            pairs: row.pairs,
        }
    }
}

/// Which distances are computed, and which stay those of the view before.
#[derive(Clone, Copy)]
pub(super) struct Anew {
    pub radiance: bool,
    /// All others.
    pub guides: bool,
}

impl Anew {
    pub(super) const ALL: Self = Self { radiance: true, guides: true };
}

/// Distances of the pairs of two rows in the order of the bandwidths, [`LENGTH`] floats each:
/// ‖ρ_c-ρ_i‖², ‖n_c-n_i‖², (v_c-v_i)², log2(1 + ‖y_c-y_i‖²) and log2(1 + ‖z_c-z_i‖²). A pair's stand from the first one
/// on that a pixel of the strip needs: for dx > 0 that is the lower row's first pixel, compared with one left of the strip.
pub(super) struct Distances(Aligned);

impl Distances {
    pub(super) fn new(radius: usize) -> Self {
        Self(Aligned::zeros((2 * radius + 1) * OF_PAIR))
    }

    /// Those of the pixels from column `x` on: [`Tap::distances`] counts from here.
    pub(super) fn at_column(&self, x: usize) -> &[f32] {
        &self.0[x..]
    }

    /// Fills in what the pixels of the `upper` and `lower` row need that are `wanted`, of the features of `set`; what is not
    /// asked for `anew` stays.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "two rows and what is wanted of them")]
    pub(super) fn compute<S: Simd>(
        &mut self,
        s: S,
        set: FeatureSet,
        anew: Anew,
        taps: &RowTaps,
        [upper, lower]: [&Row; 2],
        wanted: [bool; 2],
        width: usize,
    ) {
        for (pair, of_pair) in taps.pairs.iter().zip(self.0.chunks_exact_mut(OF_PAIR)) {
            let (right, left) = (pair.dx.max(0), (-pair.dx).max(0));
            let (down, up) = (pair.down && wanted[0], pair.up && wanted[1]);
            let width = width as isize;
            let range = match (down, up) {
                (true, true) => 0..width + right + left,
                (true, false) => right..right + width,
                (false, true) => left..left + width,
                (false, false) => continue,
            };
            // A loop for each distance: their constants stay in registers, and each is short enough that several
            // vectors are under way at once.
            let rows = PairOfRows { s, upper, lower, right, dx: pair.dx, range };
            let Anew { radiance, guides } = anew;
            let takes_part = [guides && set.albedo, guides && set.normal, guides && set.visibility, radiance, guides];
            let mut of_distances = of_pair.chunks_exact_mut(LENGTH).zip(takes_part);
            let mut next = || of_distances.next().and_then(|(values, takes_part)| takes_part.then_some(values));
            rows.fill::<0>(next());
            rows.fill::<1>(next());
            rows.fill::<2>(next());
            rows.fill::<3>(next());
            rows.fill::<4>(next());
        }
    }
}

/// Two rows whose pixels at x and x + dx are compared.
struct PairOfRows<'a, S> {
    s: S,
    upper: &'a Row,
    lower: &'a Row,
    /// Columns of the upper row left of the strip that are wanted.
    right: isize,
    dx: isize,
    range: Range<isize>,
}

impl<S: Simd> PairOfRows<'_, S> {
    /// Distance `M`, where it is wanted.
    #[inline(always)]
    fn fill<const M: usize>(&self, out: Option<&mut [f32]>) {
        let Some(out) = out else { return };
        let mut x = self.range.start;
        while x < self.range.end {
            let vectors = match ((self.range.end - x) as usize).div_ceil(S::LANES) {
                // Not one of four and one or two alone.
                5 | 6 => 3,
                left => left.min(AT_ONCE),
            };
            match vectors {
                AT_ONCE => self.fill_at::<M, AT_ONCE>(x, out),
                3 => self.fill_at::<M, 3>(x, out),
                2 => self.fill_at::<M, 2>(x, out),
                _ => self.fill_at::<M, 1>(x, out),
            }
            x += (vectors * S::LANES) as isize;
        }
    }

    /// `N` vectors from column x on.
    #[inline(always)]
    fn fill_at<const M: usize, const N: usize>(&self, x: isize, out: &mut [f32]) {
        let (s, column) = (self.s, x - self.right);
        let upper = at_columns::<S>(self.upper, column, N);
        let lower = at_columns::<S>(self.lower, column + self.dx, N);
        let mut d = [s.zero(); N];
        for (i, d) in d.iter_mut().enumerate() {
            let (upper, lower) = (&upper[i * S::LANES..], &lower[i * S::LANES..]);
            *d = match M {
                0 => between(s, upper, lower, ALBEDO),
                1 => between(s, upper, lower, NORMAL),
                2 => {
                    let d = s.sub(s.load(&upper[VISIBILITY * PITCH..]), s.load(&lower[VISIBILITY * PITCH..]));
                    s.mul(d, d)
                }
                3 => between(s, upper, lower, RADIANCE),
                _ => between(s, upper, lower, DENOISED),
            };
        }
        store_vectors(s, &mut out[x as usize..], 0, if M < 3 { d } else { s.log2_1p_each(d) });
    }
}

/// ‖a-b‖² of the three planes from `channel` on.
#[inline(always)]
fn between<S: Simd>(s: S, a: &[f32], b: &[f32], channel: usize) -> S::F {
    squared(s, &difference(s, &load3(s, a, channel), &load3(s, b, channel)))
}
