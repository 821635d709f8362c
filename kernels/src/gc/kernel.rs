//! g_c and its gradient, strip by strip of a region.
//!
//! Rows are taken in pairs: what a pixel of the upper row and one of the lower have in common
//! ([`pairs`](super::pairs)) is computed once and used while it is in the first cache, for the lower
//! pixel as a tap of the upper ([`sweep`](super::sweep)) and the other way round. So the windows of
//! radius + 1 rows grow at the same time, and a row's is complete with the pairs of which it is the
//! upper. Every pixel's taps come in the same order wherever the region's borders lie.
//!
//! Arithmetic is what bounds it: of some 45 vector operations a tap and 37 a pair with AVX-512, two
//! in a cycle, beside as many loads that straddle cache lines as fit. Of the pairs at a region's
//! borders only one pixel is inside, so large regions cost least: 8 rows 10 to 15 % more than 32.

use super::pairs::{Logarithms, RowTaps};
use super::result::{Complete, MAX_PARAMETERS};
use super::strip::{Line, Rows, STRIP};
use super::sweep::{self, SLOPE_VALUES, Sums, Sweep, WIDTHS};
use super::vector::load_lanes;
use super::{ParameterPlanes, Taps};
use crate::parameters::{BANDWIDTH_COUNT, BANDWIDTHS, SLOPE_COUNT, SLOPES};
use crate::region::Region;
use crate::simd::{Kernel, MAX_LANES, Simd};
use crate::windows::Windows;

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
    pub taps: &'a Taps,
    pub region: Region,
    pub parameters: ParameterPlanes<'a>,
    pub upstream: &'a mut U,
    pub out: &'a mut [f32],
    pub gradient: &'a mut [f32],
}

impl<U: Upstream> Kernel for Correct<'_, U> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<S: Simd>(mut self) {
        let radius = self.taps.radius();
        let mut work = Work {
            taps: self.taps.pairs().into_iter().map(RowTaps::new).collect(),
            rows: Rows::new(radius),
            sums: Sums::new(radius, U::NEEDED),
            logs: Logarithms::new(radius),
            kept: sweep::kept(),
        };
        for left in (0..self.region.width).step_by(STRIP) {
            let width = STRIP.min(self.region.width - left);
            // SAFETY: `gc::run` checked that region, parameters and outputs fit together.
            unsafe { self.strip::<S>(&mut work, radius as isize, left, width) }
        }
    }
}

/// Buffers that serve one strip after another.
struct Work {
    taps: Vec<RowTaps>,
    rows: Rows,
    sums: Sums,
    logs: Logarithms,
    kept: Vec<Line>,
}

impl<U: Upstream> Correct<'_, U> {
    #[inline(always)]
    unsafe fn strip<S: Simd>(&mut self, work: &mut Work, radius: isize, left: usize, width: usize) {
        let strip = Region { left: self.region.left + left, width, ..self.region };
        let height = strip.height as isize;
        let inside = |y: isize| (0..height).contains(&y);
        (-radius..0).for_each(|y| work.rows.copy(self.windows, &strip, y));
        for upper in -radius..height {
            work.rows.copy(self.windows, &strip, upper + radius);
            // SAFETY: `rows` holds the rows from `upper` to `upper + radius` of the strip with all that
            // their windows reach, `sums` those of the rows among them that lie in the region.
            unsafe {
                if inside(upper + radius) {
                    self.begin::<S>(work, (upper + radius) as usize, left, width);
                }
                let Work { taps, rows, sums, logs, kept } = work;
                for row in taps.iter() {
                    let lower = upper + row.dy;
                    let ends = [rows.at(upper), rows.at(lower)];
                    logs.compute::<S>(row, ends, [inside(upper), inside(lower)], width);
                    for (y, taps, [own, other]) in [(lower, &row.up, [ends[1], ends[0]]), (upper, &row.down, ends)] {
                        for x in (0..width).step_by(S::LANES).take_while(|_| inside(y)) {
                            let sweep = Sweep {
                                set: self.windows.set(),
                                masked: self.windows.masked(),
                                centre: own.add(x),
                                row: other.add(x),
                                logs: logs.at(x),
                                sums: sums.at(y as usize, x),
                                kept: kept.as_mut_ptr().cast(),
                            };
                            if U::NEEDED {
                                sweep.add_for_gradient::<S>(taps);
                            } else {
                                sweep.add::<S>(taps);
                            }
                        }
                    }
                }
                if inside(upper) {
                    self.finish::<S>(work, upper as usize, left, width);
                }
            }
        }
    }

    /// Sums of a row before its first tap.
    #[inline(always)]
    unsafe fn begin<S: Simd>(&self, work: &mut Work, y: usize, left: usize, width: usize) {
        unsafe {
            for x in (0..width).step_by(S::LANES) {
                let lanes = S::LANES.min(width - x);
                let p = load_parameters::<S>(&self.parameters, y, left + x, lanes);
                let sums = work.sums.at(y, x);
                (0..work.sums.vectors()).for_each(|i| S::store(sums.add(i * S::LANES), S::zero()));
                let unit = |m: usize| if m < 3 { -std::f32::consts::LOG2_E } else { -1.0 };
                for m in 0..BANDWIDTH_COUNT {
                    let width = S::mul(p[BANDWIDTHS + m], S::splat(unit(m)));
                    S::store(sums.add((WIDTHS + m) * S::LANES), width);
                }
                for i in 0..if U::NEEDED { SLOPE_COUNT } else { 0 } {
                    S::store(sums.add((SLOPE_VALUES + i) * S::LANES), p[SLOPES + i]);
                }
            }
        }
    }

    /// Results of a row whose windows are complete.
    #[inline(always)]
    unsafe fn finish<S: Simd>(&mut self, work: &mut Work, y: usize, left: usize, width: usize) {
        unsafe {
            let (form, plane) = (self.parameters.form, self.region.pixels());
            for x in (0..width).step_by(S::LANES) {
                let lanes = S::LANES.min(width - x);
                let p = load_parameters::<S>(&self.parameters, y, left + x, lanes);
                let centre = work.rows.at(y as isize).add(x);
                let pixels = Complete::<S>::new(p, self.windows.masked(), centre, work.sums.at(y, x));
                let corrected = pixels.corrected(form);
                let place = y * self.region.width + left + x;
                store_planes::<S>(self.out, plane, place, lanes, &corrected);
                if U::NEEDED {
                    let upstream = self.upstream.gradient::<S>(y, left + x, lanes, corrected);
                    let gradient = pixels.gradient(form, upstream);
                    store_planes::<S>(self.gradient, plane, place, lanes, &gradient[..form.parameters()]);
                }
            }
        }
    }
}

#[inline(always)]
unsafe fn load_parameters<S: Simd>(p: &ParameterPlanes, y: usize, x: usize, lanes: usize) -> [S::F; MAX_PARAMETERS] {
    unsafe {
        let at = p.start + y * p.row + x;
        let mut values = [S::splat(1.0); MAX_PARAMETERS];
        for (i, value) in values.iter_mut().enumerate().take(p.form.parameters()) {
            *value = load_lanes::<S>(p.values, i * p.plane + at, lanes);
        }
        values
    }
}

#[inline(always)]
unsafe fn store_planes<S: Simd>(out: &mut [f32], plane: usize, at: usize, lanes: usize, values: &[S::F]) {
    unsafe {
        for (i, v) in values.iter().enumerate() {
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
