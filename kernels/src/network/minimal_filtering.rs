//! The three passes of a 3x3 convolution over the padded planes of a tile, by minimal filtering of the columns: forward,
//! gradient of the input (the forward pass with turned and transposed weights) and gradient of the weights.
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
//!
//! Rows are vectorised; the sums of a block of output channels and some vectors stay in registers, so each weight is broadcast
//! once for all of these vectors, and each input vector loaded once for the block. Rows are grouped from the top of the
//! tile, so the values do not depend on the parts that it is computed in.

use super::conv::{TAPS, at_least, block_of};
use super::planes::{Band, GROUP, Geometry, LEFT, Planes};
use super::{KERNEL, MAX_CHANNELS};
use crate::aligned::Aligned;
use crate::parts::in_parts;
use crate::simd::{Isa, Kernel, Simd, dispatch};
use rayon::prelude::*;
use std::ops::Range;

/// Products of one column of a group: Winograd's points 0, ±1, ±2 and infinity.
const POINTS: usize = 6;
/// The point whose product is in all four output rows once: 1.
const POINT_OF_ALL_ROWS: usize = 1;
/// Output channels whose sums are in registers where these are many.
const MOST_OUTPUTS: usize = 8;

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
fn outputs_of_points<S: Simd>(s: S, m: [S::F; POINTS]) -> [S::F; GROUP] {
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
fn kernel_at_points([g0, g1, g2]: [f32; KERNEL]) -> [f32; POINTS] {
    let (even, odd) = ((g0 + g2) / -6.0, g1 / -6.0);
    let (outer_even, outer_odd) = (g0 / 24.0 + g2 / 6.0, g1 / 12.0);
    [g0 / 4.0, even + odd, even - odd, outer_even + outer_odd, outer_even - outer_odd, g2]
}

/// Gᵀ m: the gradient of a column of the kernel from the sums at the points.
#[inline(always)]
fn kernel_of_points<S: Simd>(s: S, m: [S::F; POINTS]) -> [S::F; KERNEL] {
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

/// Weights of one layer at the points, in the order the kernel reads them: `[output block][point][input][column][block]`.
pub(super) struct Packed {
    weights: Vec<f32>,
    bias: [f32; MAX_CHANNELS],
    inputs: usize,
}

impl Packed {
    fn new(isa: Isa, inputs: usize, weight: impl Fn(usize, usize, usize) -> f32, outputs: usize) -> Self {
        let block = block_of(isa);
        let mut weights = vec![0.0; MAX_CHANNELS * POINTS * inputs * KERNEL];
        for (o, i, column) in each(outputs, inputs) {
            let at_points = kernel_at_points([0, 1, 2].map(|row| weight(o, i, row * KERNEL + column)));
            for (m, value) in at_points.into_iter().enumerate() {
                let slot = ((o / block * POINTS + m) * inputs + i) * KERNEL + column;
                weights[slot * block + o % block] = value;
            }
        }
        Self { weights, bias: [0.0; MAX_CHANNELS], inputs }
    }

    /// A layer's kernel `[outputs][inputs][3][3]` and bias.
    pub fn forward(isa: Isa, inputs: usize, kernel: &[f32], bias: &[f32]) -> Self {
        let mut packed = Self::new(isa, inputs, |o, i, tap| kernel[(o * inputs + i) * TAPS + tap], bias.len());
        packed.bias[..bias.len()].copy_from_slice(bias);
        packed
    }

    /// The same kernel turned by 180 degrees and transposed: maps output gradients to input gradients.
    pub fn transposed(isa: Isa, inputs: usize, outputs: usize, kernel: &[f32]) -> Self {
        Self::new(isa, outputs, |i, o, tap| kernel[(o * inputs + i) * TAPS + TAPS - 1 - tap], inputs)
    }
}

/// Every output, input and column of a kernel.
fn each(outputs: usize, inputs: usize) -> impl Iterator<Item = (usize, usize, usize)> {
    (0..outputs).flat_map(move |o| (0..inputs).flat_map(move |i| (0..KERNEL).map(move |column| (o, i, column))))
}

/// What happens to a convolution's sum before it is stored.
#[derive(Clone, Copy)]
pub(super) enum Finish<'a> {
    /// Stored as it is.
    Linear,
    /// max(0, sum).
    Relu,
    /// Zero where the given activation (the ReLU's output) is zero: the ReLU's backward pass.
    MaskedBy(&'a Planes),
}

/// `output = finish(conv(input) + bias)`, all sixteen output planes, rows in as many parts at once as are asked for.
pub(super) fn convolve(isa: Isa, input: &Planes, packed: &Packed, finish: Finish, output: &mut Planes, parts: usize) {
    assert_eq!(input.geometry, output.geometry, "planes of one geometry");
    assert!(input.channels >= packed.inputs && output.channels == MAX_CHANNELS, "planes of the layer");
    if let Finish::MaskedBy(mask) = finish {
        assert!(mask.geometry == output.geometry && mask.channels == MAX_CHANNELS, "mask of the layer");
    }
    let bands = output.bands(parts);
    let of_band = |output| {
        let points = Points::zeros(packed.inputs, 1, input.geometry.stride);
        dispatch(isa, Convolve { input, packed, finish, output, points });
    };
    if parts > 1 { bands.into_par_iter().for_each(of_band) } else { bands.into_iter().for_each(of_band) }
}

/// Groups of rows of some channels at the points: `[channel][point][group][stride]`, zeros to both sides of a row.
pub(super) struct Points {
    data: Aligned,
    groups: usize,
    stride: usize,
}

impl Points {
    fn zeros(channels: usize, groups: usize, stride: usize) -> Self {
        Self { data: Aligned::zeros(channels * POINTS * groups * stride), groups, stride }
    }

    /// Room for sixteen planes of a tile.
    pub fn of_tile(geometry: Geometry) -> Self {
        Self::zeros(MAX_CHANNELS, geometry.groups(), geometry.stride)
    }

    /// Floats from one point of a channel to the next.
    fn pitch(&self) -> usize {
        self.groups * self.stride
    }

    /// Where pixel 0 of a group's row lies, at the first point.
    fn row(&self, channel: usize, group: usize) -> usize {
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
    fn take_inputs<S: Simd>(&mut self, s: S, planes: &Planes, channels: usize, from: usize, to: usize) {
        let g = planes.geometry;
        for c in 0..channels {
            // From the row above the group to the one below.
            let source = &planes.data[c * g.plane() + g.row(from * GROUP) - g.stride..];
            self.take::<S, Inputs, POINTS>(s, g, source, self.row(c, to));
        }
    }

    /// The rows of gradients of group `group` of the first `channels` planes.
    #[inline(always)]
    fn take_gradients<S: Simd>(&mut self, s: S, planes: &Planes, channels: usize, group: usize) {
        let g = planes.geometry;
        for c in 0..channels {
            let source = &planes.data[c * g.plane() + g.row(group * GROUP)..];
            self.take::<S, Gradients, GROUP>(s, g, source, self.row(c, group));
        }
    }
}

struct Convolve<'a> {
    input: &'a Planes,
    packed: &'a Packed,
    finish: Finish<'a>,
    output: Band<'a>,
    /// Room for the inputs of one group.
    points: Points,
}

impl Kernel for Convolve<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        if S::CONV_OUTPUTS == MOST_OUTPUTS {
            convolve_groups::<S, MOST_OUTPUTS, 3>(s, &mut self);
        } else {
            convolve_groups::<S, 4, 2>(s, &mut self);
        }
    }
}

#[inline(always)]
fn convolve_groups<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(s: S, work: &mut Convolve) {
    let g = work.input.geometry;
    for group in work.output.groups.clone() {
        work.points.take_inputs(s, work.input, work.packed.inputs, group, 0);
        let mut x = 0;
        while x < g.width {
            let vectors = (g.width - x).div_ceil(S::LANES).min(VECTORS);
            match vectors {
                1 => convolve_at::<S, OUTPUTS, 1>(s, work, group, x),
                vectors if vectors == VECTORS => convolve_at::<S, OUTPUTS, VECTORS>(s, work, group, x),
                _ => convolve_at::<S, OUTPUTS, 2>(s, work, group, x),
            }
            x += vectors * S::LANES;
        }
        work.output.clear_outside(g, group, x);
    }
}

/// `VECTORS` vectors of the rows of a group from column x on, all output channels.
#[inline(always)]
fn convolve_at<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(s: S, work: &mut Convolve, group: usize, x: usize) {
    let Convolve { input, packed, finish, output, points } = work;
    let g = input.geometry;
    let to = output.row(g, group * GROUP) + x;
    for block in 0..MAX_CHANNELS / OUTPUTS {
        let mut products = [[[s.zero(); VECTORS]; OUTPUTS]; POINTS];
        for (m, products) in products.iter_mut().enumerate() {
            *products = sums_at_point(s, packed, block, points, m, x);
        }
        for o in 0..OUTPUTS {
            let channel = block * OUTPUTS + o;
            let mut rows = [[s.zero(); GROUP]; VECTORS];
            for (k, rows) in rows.iter_mut().enumerate() {
                *rows = outputs_of_points(s, std::array::from_fn(|m| products[m][o][k]));
            }
            let target = &mut output.channels[channel][to..];
            match finish {
                Finish::Linear => store_rows(s, target, g.stride, rows),
                Finish::Relu => store_rows(s, target, g.stride, at_least(s, s.zero(), rows)),
                Finish::MaskedBy(mask) => {
                    let mask = &mask.data[channel * g.plane() + g.row(group * GROUP) + x..];
                    store_rows(s, target, g.stride, masked(s, mask, g.stride, rows));
                }
            }
        }
    }
}
/// Writes the rows of a group.
#[inline(always)]
fn store_rows<S: Simd, const VECTORS: usize>(s: S, to: &mut [f32], stride: usize, rows: [[S::F; GROUP]; VECTORS]) {
    assert!((GROUP - 1) * stride + VECTORS * S::LANES <= to.len(), "rows of a group");
    for (k, rows) in rows.into_iter().enumerate() {
        for (r, v) in rows.into_iter().enumerate() {
            // SAFETY: r < GROUP and k < VECTORS, so the store ends at most where the slice was seen to reach above.
            unsafe { s.store_to(to.as_mut_ptr().add(r * stride + k * S::LANES), v) };
        }
    }
}

/// The rows of a group where those of `mask` are positive, zero elsewhere.
#[inline(always)]
fn masked<S: Simd, const VECTORS: usize>(
    s: S,
    mask: &[f32],
    stride: usize,
    mut rows: [[S::F; GROUP]; VECTORS],
) -> [[S::F; GROUP]; VECTORS] {
    assert!((GROUP - 1) * stride + VECTORS * S::LANES <= mask.len(), "rows of a group");
    for (k, rows) in rows.iter_mut().enumerate() {
        for (r, v) in rows.iter_mut().enumerate() {
            // SAFETY: as in `store_rows`.
            let activation = unsafe { s.load_from(mask.as_ptr().add(r * stride + k * S::LANES)) };
            *v = s.where_positive(activation, *v);
        }
    }
    rows
}

/// Sums over inputs and columns of `VECTORS` vectors at point `m`, and the bias where it counts in all rows alike, for the output channels of one block.
#[inline(always)]
fn sums_at_point<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(
    s: S,
    packed: &Packed,
    block: usize,
    points: &Points,
    m: usize,
    x: usize,
) -> [[S::F; VECTORS]; OUTPUTS] {
    let mut sums = [[s.zero(); VECTORS]; OUTPUTS];
    if m == POINT_OF_ALL_ROWS {
        for (o, sum) in sums.iter_mut().enumerate() {
            *sum = [s.splat(packed.bias[block * OUTPUTS + o]); VECTORS];
        }
    }
    let weights = packed.weights.as_chunks::<OUTPUTS>().0.as_chunks::<KERNEL>().0;
    let weights = &weights[(block * POINTS + m) * packed.inputs..][..packed.inputs];
    // One pixel to the left.
    let start = points.row(0, 0) + m * points.pitch() + x - 1;
    let pitch = POINTS * points.pitch();
    let end = start + (packed.inputs - 1) * pitch + KERNEL - 1 + VECTORS * S::LANES;
    assert!(end <= points.data.len(), "rows of the layer's inputs");
    for (i, weights) in weights.iter().enumerate() {
        for (column, weights) in weights.iter().enumerate() {
            let mut v = [s.zero(); VECTORS];
            for (k, v) in v.iter_mut().enumerate() {
                // SAFETY: i is an input, column < KERNEL and k < VECTORS, so the load ends at most at `end`, which was
                // checked above.
                *v = unsafe { s.load_from(points.data.as_ptr().add(start + i * pitch + column + k * S::LANES)) };
            }
            for (sum, weight) in sums.iter_mut().zip(weights) {
                let weight = s.splat(*weight);
                for k in 0..VECTORS {
                    sum[k] = s.fma(weight, v[k], sum[k]);
                }
            }
        }
    }
    sums
}

/// Room for the gradient of a layer's weights.
pub(super) struct Room {
    inputs: Points,
    upstream: Points,
}

impl Room {
    /// For tiles of this size.
    pub fn of_tile(geometry: Geometry) -> Self {
        Self { inputs: Points::of_tile(geometry), upstream: Points::of_tile(geometry) }
    }
}

/// Adds the gradient of one layer's kernel and bias to `gradient` (`[outputs][inputs][3][3]`, then
/// `[outputs]`), given the layer's input and the gradient of its output; inputs in as many parts at once as are asked for.
#[expect(clippy::too_many_arguments, reason = "a layer, its size and where its gradient goes")]
pub(super) fn weight_gradient(
    isa: Isa,
    input: &Planes,
    inputs: usize,
    upstream: &Planes,
    outputs: usize,
    room: &mut Room,
    gradient: &mut [f32],
    parts: usize,
) {
    assert_eq!(input.geometry, upstream.geometry, "planes of one geometry");
    assert_eq!(gradient.len(), outputs * (inputs * TAPS + 1), "gradient of the layer");
    assert!(input.channels >= inputs && upstream.channels == MAX_CHANNELS, "planes of the layer");
    dispatch(isa, TakePoints { input, inputs, upstream, outputs, room });
    let of = |range, gradient: &mut [f32]| {
        dispatch(isa, WeightGradient { room, geometry: input.geometry, inputs, range, outputs, gradient });
    };
    if parts <= 1 {
        of(0..inputs, gradient);
    } else {
        // Each weight belongs to one part; elsewhere a part adds zeros.
        let of_part = |range| {
            let mut own = vec![0.0; gradient.len()];
            of(range, &mut own);
            own
        };
        let of_parts: Vec<Vec<f32>> = in_parts(inputs, parts).into_par_iter().map(of_part).collect();
        for own in of_parts {
            gradient.iter_mut().zip(own).for_each(|(sum, value)| *sum += value);
        }
    }
    dispatch(isa, BiasGradient { upstream, bias: &mut gradient[outputs * inputs * TAPS..] });
}

struct TakePoints<'a> {
    input: &'a Planes,
    inputs: usize,
    upstream: &'a Planes,
    outputs: usize,
    room: &'a mut Room,
}

impl Kernel for TakePoints<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        for group in 0..self.input.geometry.groups() {
            self.room.inputs.take_inputs(s, self.input, self.inputs, group, group);
            self.room.upstream.take_gradients(s, self.upstream, self.outputs, group);
        }
    }
}

struct WeightGradient<'a> {
    room: &'a Room,
    geometry: Geometry,
    inputs: usize,
    /// The inputs whose weights are at hand.
    range: Range<usize>,
    outputs: usize,
    gradient: &'a mut [f32],
}

impl Kernel for WeightGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        if S::CONV_OUTPUTS == MOST_OUTPUTS {
            gradient_blocks::<S, MOST_OUTPUTS>(s, &mut self);
        } else {
            gradient_blocks::<S, 4>(s, &mut self);
        }
    }
}

#[inline(always)]
fn gradient_blocks<S: Simd, const OUTPUTS: usize>(s: S, work: &mut WeightGradient) {
    // Sums of a block: `[input][point][output][column]`, a vector each.
    let of_input = POINTS * OUTPUTS * KERNEL * S::LANES;
    let mut done = Aligned::zeros(MAX_CHANNELS * of_input);
    for first in (0..work.outputs).step_by(OUTPUTS) {
        // One point of the block's outputs stays in the first cache for all inputs.
        for (m, i) in (0..POINTS).flat_map(|m| work.range.clone().map(move |i| (m, i))) {
            let sums = gradient_sums::<S, OUTPUTS>(s, work, first, i, m);
            let to = &mut done[i * of_input + m * OUTPUTS * KERNEL * S::LANES..];
            for (o, sum) in sums.iter().enumerate() {
                for (c, v) in sum.iter().enumerate() {
                    s.store(&mut to[(o * KERNEL + c) * S::LANES..], *v);
                }
            }
        }
        for (o, i, column) in
            each(OUTPUTS.min(work.outputs - first), work.inputs).filter(|(_, i, _)| work.range.contains(i))
        {
            let sums = std::array::from_fn(|m| {
                s.load(&done[i * of_input + ((m * OUTPUTS + o) * KERNEL + column) * S::LANES..])
            });
            for (row, v) in kernel_of_points(s, sums).into_iter().enumerate() {
                let slot = ((first + o) * work.inputs + i) * TAPS + row * KERNEL + column;
                work.gradient[slot] += s.sum(v);
            }
        }
    }
}

/// Lane by lane, the sums of products of input `i` and the outputs from `first` on at point `m`, for each column of
/// the kernel.
#[inline(always)]
fn gradient_sums<S: Simd, const OUTPUTS: usize>(
    s: S,
    work: &WeightGradient,
    first: usize,
    i: usize,
    m: usize,
) -> [[S::F; KERNEL]; OUTPUTS] {
    let (g, Room { inputs, upstream }) = (work.geometry, work.room);
    let pitch = upstream.pitch();
    let upstream_row = &upstream.data[upstream.row(first, 0) + m * pitch..];
    // One pixel to the left.
    let input = &inputs.data[inputs.row(i, 0) + m * pitch - 1..];
    let end = (g.groups() - 1) * g.stride + g.width.next_multiple_of(S::LANES);
    assert!(end + KERNEL - 1 <= input.len() && (OUTPUTS - 1) * POINTS * pitch + end <= upstream_row.len());
    let mut sums = [[s.zero(); KERNEL]; OUTPUTS];
    for group in 0..g.groups() {
        for x in (0..g.width).step_by(S::LANES) {
            let at = group * g.stride + x;
            // SAFETY: at + LANES <= end, and c < KERNEL and o < OUTPUTS: all loads lie before the ends that
            // were checked above.
            unsafe {
                let mut v = [s.zero(); KERNEL];
                for (c, v) in v.iter_mut().enumerate() {
                    *v = s.load_from(input.as_ptr().add(at + c));
                }
                for (o, sum) in sums.iter_mut().enumerate() {
                    let u = s.load_from(upstream_row.as_ptr().add(o * POINTS * pitch + at));
                    for c in 0..KERNEL {
                        sum[c] = s.fma(u, v[c], sum[c]);
                    }
                }
            }
        }
    }
    sums
}

/// Sums of the gradients of the outputs.
struct BiasGradient<'a> {
    upstream: &'a Planes,
    bias: &'a mut [f32],
}

impl Kernel for BiasGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let g = self.upstream.geometry;
        for (o, bias) in self.bias.iter_mut().enumerate() {
            let upstream = &self.upstream.data[o * g.plane() + g.row(0)..];
            let mut sum = s.zero();
            for y in 0..g.height {
                for x in (0..g.width).step_by(S::LANES) {
                    sum = s.add(sum, s.load(&upstream[y * g.stride + x..]));
                }
            }
            *bias += s.sum(sum);
        }
    }
}
