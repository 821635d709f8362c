//! g_c and its gradient, strip by strip of a region.
//!
//! Rows are taken in pairs: what a pixel of the upper row and one of the lower have in common
//! ([`pair_distances`](super::pair_distances)) is computed once and used while it is in the first cache, for the
//! lower pixel as a tap of the upper ([`tap_sums`](super::tap_sums)) and the other way round. So the windows of
//! radius + 1 rows grow at the same time, and a row's is complete with the pairs of which it is the
//! upper. Every pixel's taps come in the same order wherever the region's borders lie.
//!
//! Several views of the same pixels go through a pair of rows one after the other, and what a view shares with the one before
//! stays where it is: both halves by their own guides and by those of the full buffer need 14 distances of a pair, not 20, and
//! five logarithms, not eight.
//!
//! Bound by arithmetic and loads alike: 40 vector operations per tap, 75 with the gradient, and 60 per pair; a tap's
//! loads lie anywhere, so with eight lanes two in five straddle cache lines. Polynomials are computed for several vectors at
//! once ([`Simd::log2_1p_each`]), since one alone waits for itself. Only one pixel of a pair at a region's border is inside,
//! so large regions cost least: 8 rows 10 to 15 % more per pixel than 32.

use super::from_sums::{Complete, MAX_PARAMETERS};
use super::pair_distances::{Anew, Distances, RowTaps};
use super::strip::{Row, Rows, STRIP, at_column};
use super::tap_sums::{Sums, TapRow, begin, tap_values};
use super::{JointCorrection, ParameterPlanes, View};
use crate::aligned::Aligned;
use crate::features::FeatureSet;
use crate::region::Region;
use crate::simd::{Kernel, Simd};

/// Answers with the gradient of a loss by the corrected radiance.
pub trait Upstream {
    /// False leaves the backward passes out.
    const NEEDED: bool;

    /// Gradient of the loss by μ̂ for the pixels (y, x .. x + lanes) of the region. Must be
    /// `#[inline(always)]`, as [`Kernel::run`] must.
    fn gradient<S: Simd>(&mut self, s: S, y: usize, x: usize, lanes: usize, corrected: [S::F; 3]) -> [S::F; 3];
}

/// Forward only.
pub struct NoUpstream;

impl Upstream for NoUpstream {
    const NEEDED: bool = false;

    #[inline(always)]
    fn gradient<S: Simd>(&mut self, _: S, _: usize, _: usize, _: usize, corrected: [S::F; 3]) -> [S::F; 3] {
        corrected
    }
}

pub(super) struct Correct<'a, U> {
    pub of: &'a JointCorrection<'a>,
    pub upstream: &'a mut U,
    /// Of every view.
    pub out: &'a mut [f32],
    /// Of the only view.
    pub gradient: &'a mut [f32],
}

impl<U: Upstream> Kernel for Correct<'_, U> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        let radius = self.of.taps.radius();
        let mut work = Work {
            taps: self.of.taps.pairs().into_iter().map(RowTaps::new).collect(),
            views: self.of.views.iter().map(|_| ViewWork::new(radius, U::NEEDED)).collect(),
            distances: Distances::new(radius),
            tap_values: tap_values(),
        };
        for left in (0..self.of.region.width).step_by(STRIP) {
            let width = STRIP.min(self.of.region.width - left);
            self.strip(s, &mut work, radius as isize, left, width);
        }
    }
}

/// Buffers that serve one strip after another.
struct Work {
    taps: Vec<RowTaps>,
    views: Vec<ViewWork>,
    distances: Distances,
    tap_values: Aligned,
}

/// Those of one view.
struct ViewWork {
    rows: Rows,
    sums: Sums,
}

impl ViewWork {
    fn new(radius: usize, gradient: bool) -> Self {
        Self { rows: Rows::new(radius), sums: Sums::new(radius, gradient) }
    }
}

/// Which distances of a view have to be computed: the others are there, of the view before.
fn anew(views: &[View], at: usize) -> Anew {
    let Some(before) = at.checked_sub(1).map(|before| &views[before]) else { return Anew::ALL };
    let View { radiance, guides, .. } = views[at];
    Anew { radiance: !std::ptr::eq(before.radiance, radiance), guides: !std::ptr::eq(before.guides, guides) }
}

impl<U: Upstream> Correct<'_, U> {
    #[inline(always)]
    fn strip<S: Simd>(&mut self, s: S, work: &mut Work, radius: isize, left: usize, width: usize) {
        let (views, region) = (&self.of.views, &self.of.region);
        let strip = Region { left: region.left + left, width, ..*region };
        let (set, masked) = (views[0].guides.set(), views[0].guides.masked());
        let height = strip.height as isize;
        let inside = |y: isize| (0..height).contains(&y);
        for (view, work) in views.iter().zip(&mut work.views) {
            (-radius..0).for_each(|y| work.rows.copy(view.radiance, view.guides, &strip, y));
        }
        for upper in -radius..height {
            for (view, work) in views.iter().zip(&mut work.views) {
                work.rows.copy(view.radiance, view.guides, &strip, upper + radius);
                if inside(upper + radius) {
                    Self::begin(s, view, &mut work.sums, (upper + radius) as usize, left, width);
                }
            }
            let Work { taps, views: of_views, distances, tap_values } = &mut *work;
            for row in taps.iter() {
                let lower = upper + row.dy;
                // For a gradient there is one view, so that the loop and what depends on it go.
                let count = if U::NEEDED { 1 } else { of_views.len() };
                for (at, ViewWork { rows, sums }) in of_views.iter_mut().enumerate().take(count) {
                    let anew = if U::NEEDED { Anew::ALL } else { anew(views, at) };
                    let two = TwoRows {
                        s,
                        set,
                        masked,
                        taps: row,
                        ends: [rows.row(upper), rows.row(lower)],
                        inside: [inside(upper), inside(lower)],
                        y: [upper as usize, lower as usize],
                        width,
                    };
                    two.add::<U>(anew, distances, sums, tap_values);
                }
            }
            if inside(upper) {
                for (at, of_view) in work.views.iter_mut().enumerate() {
                    self.finish(s, of_view, at, upper as usize, left, width);
                }
            }
        }
    }

    /// Sums of a row before its first tap.
    #[inline(always)]
    fn begin<S: Simd>(s: S, view: &View, sums: &mut Sums, y: usize, left: usize, width: usize) {
        for x in (0..width).step_by(S::LANES) {
            let lanes = S::LANES.min(width - x);
            let p = load_parameters(s, &view.parameters, y, left + x, lanes);
            begin(s, &p, U::NEEDED, sums.at::<S>(y, x));
        }
    }

    /// Results of a row whose windows are complete.
    #[inline(always)]
    fn finish<S: Simd>(&mut self, s: S, work: &mut ViewWork, at: usize, y: usize, left: usize, width: usize) {
        let JointCorrection { views, region, .. } = self.of;
        let View { guides, parameters, .. } = views[at];
        let (form, plane) = (parameters.form, region.pixels());
        for x in (0..width).step_by(S::LANES) {
            let lanes = S::LANES.min(width - x);
            let p = load_parameters(s, &parameters, y, left + x, lanes);
            let centre = at_column::<S>(work.rows.row(y as isize), x as isize);
            let pixels = Complete::new(s, p, guides.masked(), centre, work.sums.at::<S>(y, x));
            let corrected = pixels.corrected(form);
            let place = y * region.width + left + x;
            store_planes(s, &mut self.out[3 * at * plane..], plane, place, lanes, &corrected);
            if U::NEEDED {
                let upstream = self.upstream.gradient(s, y, left + x, lanes, corrected);
                let gradient = pixels.gradient(form, upstream);
                store_planes(s, self.gradient, plane, place, lanes, &gradient[..form.parameters()]);
            }
        }
    }
}

/// Two rows of pixels of a strip, the upper one first, that are taps of each other.
struct TwoRows<'a, S> {
    s: S,
    set: FeatureSet,
    masked: bool,
    taps: &'a RowTaps,
    ends: [&'a Row; 2],
    /// Whether they are rows of the region, and which.
    inside: [bool; 2],
    y: [usize; 2],
    width: usize,
}

impl<S: Simd> TwoRows<'_, S> {
    /// Adds the taps of either row in the other to the sums.
    #[inline(always)]
    fn add<U: Upstream>(&self, anew: Anew, distances: &mut Distances, sums: &mut Sums, tap_values: &mut [f32]) {
        let &Self { s, set, masked, taps, ends, inside, y, width } = self;
        distances.compute(s, set, anew, taps, ends, inside, width);
        for (y, inside, taps, [own, other]) in
            [(y[1], inside[1], &taps.up, [ends[1], ends[0]]), (y[0], inside[0], &taps.down, ends)]
        {
            for x in (0..width).step_by(S::LANES).take_while(|_| inside) {
                let tap_row = TapRow { s, set, masked, x, own, other, distances: distances.at_column(x) };
                let sums = sums.at::<S>(y, x);
                if U::NEEDED {
                    tap_row.add_for_gradient(taps, sums, tap_values);
                } else {
                    tap_row.add(taps, sums, tap_values);
                }
            }
        }
    }
}

#[inline(always)]
pub(super) fn load_parameters<S: Simd>(
    s: S,
    p: &ParameterPlanes,
    y: usize,
    x: usize,
    lanes: usize,
) -> [S::F; MAX_PARAMETERS] {
    let at = p.start + y * p.row + x;
    let mut values = [s.splat(1.0); MAX_PARAMETERS];
    for (i, value) in values.iter_mut().enumerate().take(p.form.parameters()) {
        *value = s.load_part(&p.values[i * p.plane + at..][..lanes]);
    }
    values
}

#[inline(always)]
pub(super) fn store_planes<S: Simd>(s: S, out: &mut [f32], plane: usize, at: usize, lanes: usize, values: &[S::F]) {
    for (i, v) in values.iter().enumerate() {
        s.store_part(&mut out[i * plane + at..][..lanes], *v);
    }
}
