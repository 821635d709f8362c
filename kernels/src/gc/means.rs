//! Means of further planes over the window Ω_c by g_c's own weights (Eq. 11): what of g_c averages, and nothing of its slopes.
//!
//! With fixed weights that is linear in the planes: the means of planes that add up add up. Weights are computed once for
//! all of them; a plane costs a multiplication and an addition per tap.

use super::from_sums::MAX_PARAMETERS;
use super::kernel::{load_parameters, store_planes};
use super::pair_distances::{Anew, Distances, RowTaps};
use super::strip::{LEFT, PITCH, Rows, STRIP, at_column};
use super::tap_sums::{SCALE, Sums, TapRow, WEIGHT, begin, tap_values};
use super::{Correction, WEIGHT_FLOOR};
use crate::aligned::Aligned;
use crate::features::FEATURE_CHANNELS;
use crate::parameters::CENTRE;
use crate::region::Region;
use crate::simd::{Kernel, MAX_LANES, Simd};
use crate::windows::PaddedPlanes;

/// The sums of the planes, in vectors of the sums of one vector of pixels.
const PLANE_SUMS: usize = WEIGHT + 1;
/// Planes whose sums stay in registers.
const AT_ONCE: usize = 6;

pub(super) struct Means<'a> {
    pub of: Correction<'a>,
    pub planes: &'a PaddedPlanes,
    pub out: &'a mut [f32],
}

/// Buffers that serve one strip after another.
struct Work {
    taps: Vec<RowTaps>,
    rows: Rows,
    planes: PlaneRows,
    sums: Sums,
    distances: Distances,
    weights: Aligned,
}

impl Kernel for Means<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        let radius = self.of.taps.radius();
        let count = self.planes.count();
        let mut work = Work {
            taps: self.of.taps.pairs().into_iter().map(RowTaps::new).collect(),
            rows: Rows::new(radius),
            planes: PlaneRows::new(radius, count),
            sums: Sums::of_vectors(radius, PLANE_SUMS + count),
            distances: Distances::new(radius),
            weights: tap_values(),
        };
        for left in (0..self.of.region.width).step_by(STRIP) {
            let width = STRIP.min(self.of.region.width - left);
            self.strip(s, &mut work, radius as isize, left, width);
        }
    }
}

impl Means<'_> {
    /// As the strips of g_c itself (`kernel`).
    #[inline(always)]
    fn strip<S: Simd>(&mut self, s: S, work: &mut Work, radius: isize, left: usize, width: usize) {
        let strip = Region { left: self.of.region.left + left, width, ..self.of.region };
        let height = strip.height as isize;
        let inside = |y: isize| (0..height).contains(&y);
        for y in -radius..0 {
            work.rows.copy(self.of.windows, self.of.windows, &strip, y);
            work.planes.copy(self.planes, &strip, y);
        }
        for upper in -radius..height {
            work.rows.copy(self.of.windows, self.of.windows, &strip, upper + radius);
            work.planes.copy(self.planes, &strip, upper + radius);
            if inside(upper + radius) {
                self.begin(s, work, (upper + radius) as usize, left, width);
            }
            let (set, masked) = (self.of.windows.set(), self.of.windows.masked());
            let Work { taps, rows, planes, sums, distances, weights } = work;
            for row in taps.iter() {
                let lower = upper + row.dy;
                let ends = [rows.row(upper), rows.row(lower)];
                distances.compute(s, set, Anew::ALL, row, ends, [inside(upper), inside(lower)], width);
                for (y, of_taps, taps, [own, other]) in
                    [(lower, upper, &row.up, [ends[1], ends[0]]), (upper, lower, &row.down, ends)]
                {
                    for x in (0..width).step_by(S::LANES).take_while(|_| inside(y)) {
                        let tap_row = TapRow { s, set, masked, x, own, other, distances: distances.at_column(x) };
                        let sums = sums.at::<S>(y as usize, x);
                        tap_row.add_weights(taps, sums, weights);
                        let values = planes.row(of_taps);
                        for (chunk, sums) in sums[PLANE_SUMS * S::LANES..].chunks_mut(AT_ONCE * S::LANES).enumerate() {
                            let values = &values[chunk * AT_ONCE * PITCH..];
                            let columns = taps.iter().map(|tap| LEFT.strict_add_signed(x as isize + tap.dx));
                            add(s, columns, weights, values, sums);
                        }
                    }
                }
            }
            if inside(upper) {
                self.finish(s, work, upper as usize, left, width);
            }
        }
    }

    /// Sums of a row before its first tap.
    #[inline(always)]
    fn begin<S: Simd>(&self, s: S, work: &mut Work, y: usize, left: usize, width: usize) {
        for x in (0..width).step_by(S::LANES) {
            let lanes = S::LANES.min(width - x);
            let p = load_parameters(s, &self.of.parameters, y, left + x, lanes);
            begin(s, &p, false, work.sums.at::<S>(y, x));
        }
    }

    /// Means of a row whose windows are complete.
    #[inline(always)]
    fn finish<S: Simd>(&mut self, s: S, work: &mut Work, y: usize, left: usize, width: usize) {
        let plane = self.of.region.pixels();
        for x in (0..width).step_by(S::LANES) {
            let lanes = S::LANES.min(width - x);
            let p: [S::F; MAX_PARAMETERS] = load_parameters(s, &self.of.parameters, y, left + x, lanes);
            let centre = at_column::<S>(work.rows.row(y as isize), x as isize);
            let valid =
                if self.of.windows.masked() { s.load(&centre[FEATURE_CHANNELS * PITCH..]) } else { s.splat(1.0) };
            let w_c = s.mul(s.mul(p[CENTRE], s.splat(SCALE)), valid);
            let sums = work.sums.at::<S>(y, x);
            let weight = s.add(s.load(&sums[WEIGHT * S::LANES..]), w_c);
            let inverse = s.div(s.splat(1.0), s.max(weight, s.splat(SCALE * WEIGHT_FLOOR)));
            let own = &work.planes.row(y as isize)[LEFT + x..];
            let at = y * self.of.region.width + left + x;
            for c in 0..self.planes.count() {
                let sum = s.fma(w_c, s.load(&own[c * PITCH..]), s.load(&sums[(PLANE_SUMS + c) * S::LANES..]));
                store_planes(s, &mut self.out[c * plane..][..plane], plane, at, lanes, &[s.mul(sum, inverse)]);
            }
        }
    }
}

/// Adds the taps, which begin at these columns of the rows `values`, to the sums of some planes, at most [`AT_ONCE`].
#[inline(always)]
fn add<S: Simd>(s: S, columns: impl Iterator<Item = usize>, weights: &[f32], values: &[f32], sums: &mut [f32]) {
    if sums.len() == AT_ONCE * S::LANES {
        let mut terms = [s.zero(); AT_ONCE];
        for (term, sum) in terms.iter_mut().zip(sums.chunks_exact(S::LANES)) {
            *term = s.load(sum);
        }
        for (column, weight) in columns.zip(weights.chunks_exact(S::LANES)) {
            let (w, at) = (s.load(weight), &values[column..][..(AT_ONCE - 1) * PITCH + S::LANES]);
            for (c, term) in terms.iter_mut().enumerate() {
                *term = s.fma(w, s.load(&at[c * PITCH..]), *term);
            }
        }
        for (term, sum) in terms.iter().zip(sums.chunks_exact_mut(S::LANES)) {
            s.store(sum, *term);
        }
        return;
    }
    for (column, weight) in columns.zip(weights.chunks_exact(S::LANES)) {
        let w = s.load(weight);
        for (c, sum) in sums.chunks_exact_mut(S::LANES).enumerate() {
            let term = s.fma(w, s.load(&values[column + c * PITCH..]), s.load(sum));
            s.store(sum, term);
        }
    }
}

/// The rows of the planes that a row of pixels is averaged over, itself included, as a ring.
struct PlaneRows {
    data: Aligned,
    radius: usize,
    count: usize,
}

impl PlaneRows {
    fn new(radius: usize, count: usize) -> Self {
        Self { data: Aligned::zeros((radius + 1) * count * PITCH), radius, count }
    }

    /// Copies row `y` (from -radius on) of a strip with all that its windows reach to either side.
    fn copy(&mut self, planes: &PaddedPlanes, strip: &Region, y: isize) {
        let width = strip.width + 2 * self.radius + MAX_LANES;
        let at = self.slot(y) * self.count * PITCH + LEFT - self.radius;
        for c in 0..self.count {
            let source = planes.row(c, strip.top as isize + y, strip.left as isize - self.radius as isize);
            self.data[at + c * PITCH..][..width].copy_from_slice(&source[..width]);
        }
    }

    /// All planes of row `y`, [`PITCH`] floats each.
    fn row(&self, y: isize) -> &[f32] {
        &self.data[self.slot(y) * self.count * PITCH..][..self.count * PITCH]
    }

    fn slot(&self, y: isize) -> usize {
        (y + self.radius as isize) as usize % (self.radius + 1)
    }
}
