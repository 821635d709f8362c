//! The convolution of a tile's padded planes, forward and, with turned and transposed weights, of gradients back to a
//! layer's input.
//!
//! Rows are vectorised; the sums of a block of output channels and some vectors stay in registers, so each weight is broadcast
//! once for all of these vectors, and each input vector loaded once for the block. Rows are grouped from the top of the
//! tile ([`points`](super::points)), so the values do not depend on the parts that it is computed in.

use super::conv::{MOST_OUTPUTS, TAPS, at_least, block_of};
use super::planes::{Band, GROUP, Planes};
use super::points::{POINT_OF_ALL_ROWS, POINTS, Points, kernel_at_points, outputs_of_points};
use super::{KERNEL, MAX_CHANNELS};
use crate::simd::{Isa, Kernel, Simd, dispatch};
use rayon::prelude::*;

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
pub(super) fn each(outputs: usize, inputs: usize) -> impl Iterator<Item = (usize, usize, usize)> {
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
                let mut at_points = [s.zero(); POINTS];
                for (value, products) in at_points.iter_mut().zip(&products) {
                    *value = products[o][k];
                }
                *rows = outputs_of_points(s, at_points);
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
