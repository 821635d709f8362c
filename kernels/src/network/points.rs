//! Rows of a tile as its convolutions multiply them: minimal filtering of the columns.
//!
//! Winograd's F(4, 3) (Lavin and Gray 2016, arXiv 1509.09308) computes four rows of outputs from six rows of inputs with
//! six multiplications in the place of twelve. With d the six input rows, g a column of the kernel and u four rows of
//! the outputs' gradient,
//!
//! ```text
//! o = Aᵀ [ (G g) ∘ (Bᵀ d) ]        by g: Gᵀ [ (A u) ∘ (Bᵀ d) ]
//! ```
//!
//! where products are summed over input channels and over the kernel's three columns, which stay as they are; in the gradient,
//! over all pixels. What Bᵀ, Aᵀ and A do is small beside it: each row is transformed once for sixteen channels.

use super::planes::{GROUP, Geometry, LEFT, Planes};
use super::{KERNEL, MAX_CHANNELS};
use crate::aligned::Aligned;
use crate::simd::Simd;

/// Products of one column of a group: Winograd's points 0, ±1, ±2 and infinity.
pub(super) const POINTS: usize = 6;
/// The point whose product is in all four output rows once: 1.
pub(super) const POINT_OF_ALL_ROWS: usize = 1;

/// Rows of a group as they are multiplied.
trait AtPoints<const ROWS: usize> {
    /// Must be `#[inline(always)]`, as [`Kernel::run`] must.
    fn at_points<S: Simd>(s: S, rows: [S::F; ROWS]) -> [S::F; POINTS];
}

/// Bᵀ d: six input rows at the points.
struct Inputs;

impl AtPoints<POINTS> for Inputs {
    #[inline(always)]
    fn at_points<S: Simd>(s: S, d: [S::F; POINTS]) -> [S::F; POINTS] {
        let [d0, d1, d2, d3, d4, d5] = d;
        let (two, four, five) = (s.splat(2.0), s.splat(4.0), s.splat(-5.0));
        let minus_four = s.splat(-4.0);
        let (even, odd) = (s.fma(minus_four, d2, d4), s.fma(minus_four, d1, d3));
        let (outer_even, outer_odd) = (s.sub(d4, d2), s.mul(two, s.sub(d3, d1)));
        [
            s.fma(four, d0, s.fma(five, d2, d4)),
            s.add(even, odd),
            s.sub(even, odd),
            s.add(outer_even, outer_odd),
            s.sub(outer_even, outer_odd),
            s.fma(four, d1, s.fma(five, d3, d5)),
        ]
    }
}

/// Aᵀ m: four output rows of the products at the points.
#[inline(always)]
pub(super) fn outputs_of_points<S: Simd>(s: S, m: [S::F; POINTS]) -> [S::F; GROUP] {
    let [m0, m1, m2, m3, m4, m5] = m;
    let (p, q) = (s.add(m1, m2), s.sub(m1, m2));
    let (outer_p, outer_q) = (s.add(m3, m4), s.sub(m3, m4));
    [
        s.add(m0, s.add(p, outer_p)),
        s.fma(s.splat(2.0), outer_q, q),
        s.fma(s.splat(4.0), outer_p, p),
        s.add(m5, s.fma(s.splat(8.0), outer_q, q)),
    ]
}

/// A u: four rows of the outputs' gradient at the points.
struct Gradients;

impl AtPoints<GROUP> for Gradients {
    #[inline(always)]
    fn at_points<S: Simd>(s: S, u: [S::F; GROUP]) -> [S::F; POINTS] {
        let [u0, u1, u2, u3] = u;
        let (even, odd) = (s.add(u0, u2), s.add(u1, u3));
        let outer_even = s.fma(s.splat(4.0), u2, u0);
        let outer_odd = s.mul(s.splat(2.0), s.fma(s.splat(4.0), u3, u1));
        [u0, s.add(even, odd), s.sub(even, odd), s.add(outer_even, outer_odd), s.sub(outer_even, outer_odd), u3]
    }
}

/// G g: a column of a kernel at the points.
pub(super) fn kernel_at_points([g0, g1, g2]: [f32; KERNEL]) -> [f32; POINTS] {
    let (even, odd) = ((g0 + g2) / -6.0, g1 / -6.0);
    let (outer_even, outer_odd) = (g0 / 24.0 + g2 / 6.0, g1 / 12.0);
    [g0 / 4.0, even + odd, even - odd, outer_even + outer_odd, outer_even - outer_odd, g2]
}

/// Gᵀ m: the gradient of a column of the kernel from the sums at the points.
#[inline(always)]
pub(super) fn kernel_of_points<S: Simd>(s: S, m: [S::F; POINTS]) -> [S::F; KERNEL] {
    let [m0, m1, m2, m3, m4, m5] = m;
    let sixth = s.splat(1.0 / 6.0);
    let (p, q) = (s.mul(sixth, s.add(m1, m2)), s.mul(sixth, s.sub(m2, m1)));
    let (outer_p, outer_q) = (s.mul(sixth, s.add(m3, m4)), s.sub(m3, m4));
    [
        s.sub(s.mul(s.splat(0.25), s.add(m0, outer_p)), p),
        s.fma(s.splat(1.0 / 12.0), outer_q, q),
        s.add(m5, s.sub(outer_p, p)),
    ]
}

/// Groups of rows of some channels at the points: `[channel][point][group][stride]`, zeros to both sides of a row.
pub(super) struct Points {
    pub data: Aligned,
    groups: usize,
    stride: usize,
}

impl Points {
    pub fn zeros(channels: usize, groups: usize, stride: usize) -> Self {
        Self { data: Aligned::zeros(channels * POINTS * groups * stride + LEFT), groups, stride }
    }

    /// Room for sixteen planes of a tile.
    pub fn of_tile(geometry: Geometry) -> Self {
        Self::zeros(MAX_CHANNELS, geometry.groups(), geometry.stride)
    }

    /// Floats from one point of a channel to the next.
    pub fn pitch(&self) -> usize {
        self.groups * self.stride
    }

    /// Where pixel 0 of a group's row lies, at the first point.
    pub fn row(&self, channel: usize, group: usize) -> usize {
        channel * POINTS * self.pitch() + group * self.stride + LEFT
    }

    /// Writes `ROWS` rows of a plane, from `source` on, at the points: as the rows of a group from `at` on.
    #[inline(always)]
    fn take<S: Simd, T: AtPoints<ROWS>, const ROWS: usize>(&mut self, s: S, g: Geometry, source: &[f32], at: usize) {
        let (pitch, end) = (self.pitch(), g.width.next_multiple_of(S::LANES));
        let to = &mut self.data[at..];
        assert!(
            (ROWS - 1) * g.stride + end <= source.len() && (POINTS - 1) * pitch + end <= to.len(),
            "rows of a group"
        );
        for x in (0..g.width).step_by(S::LANES) {
            // SAFETY: x + LANES <= end, so loads and stores lie before the ends that were checked above.
            unsafe {
                let mut rows = [s.zero(); ROWS];
                for (r, row) in rows.iter_mut().enumerate() {
                    *row = s.load_from(source.as_ptr().add(r * g.stride + x));
                }
                for (m, value) in T::at_points(s, rows).into_iter().enumerate() {
                    s.store_to(to.as_mut_ptr().add(m * pitch + x), value);
                }
            }
        }
    }

    /// The input rows of group `from` of the first `channels` planes, as group `to`.
    #[inline(always)]
    pub fn take_inputs<S: Simd>(&mut self, s: S, planes: &Planes, channels: usize, from: usize, to: usize) {
        let g = planes.geometry;
        for c in 0..channels {
            // From the row above the group to the one below.
            let source = &planes.data[c * g.plane() + g.row(from * GROUP) - g.stride..];
            self.take::<S, Inputs, POINTS>(s, g, source, self.row(c, to));
        }
    }

    /// The rows of gradients of group `group` of the first `channels` planes.
    #[inline(always)]
    pub fn take_gradients<S: Simd>(&mut self, s: S, planes: &Planes, channels: usize, group: usize) {
        let g = planes.geometry;
        for c in 0..channels {
            let source = &planes.data[c * g.plane() + g.row(group * GROUP)..];
            self.take::<S, Gradients, GROUP>(s, g, source, self.row(c, group));
        }
    }
}
