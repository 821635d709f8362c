//! The three passes of a 3x3 convolution over padded planes: forward, gradient of the input (the
//! forward pass with turned and transposed weights) and gradient of the weights.
//!
//! Rows are vectorised; a block of output channels and two row vectors stay in registers, so each
//! weight is broadcast once for two multiply-adds and each input vector is loaded once for a block.

use super::planes::{Band, Planes};
use super::{KERNEL, MAX_CHANNELS};
use crate::parts::in_parts;
use crate::simd::{Isa, Kernel, MAX_LANES, Simd, dispatch};
use rayon::prelude::*;
use std::ops::Range;

pub(super) const TAPS: usize = KERNEL * KERNEL;

/// Weights of one layer in the order the kernel reads them: `[output block][input][tap][block]`.
pub(super) struct Packed {
    weights: Vec<f32>,
    bias: [f32; MAX_CHANNELS],
    inputs: usize,
}

/// [`Simd::CONV_OUTPUTS`] of the instruction set.
fn block_of(isa: Isa) -> usize {
    match isa {
        Isa::Avx512 => 8,
        _ => 4,
    }
}

impl Packed {
    fn new(isa: Isa, inputs: usize, weight: impl Fn(usize, usize, usize) -> f32, outputs: usize) -> Self {
        let block = block_of(isa);
        let mut weights = vec![0.0; MAX_CHANNELS * inputs * TAPS];
        for o in 0..outputs {
            for i in 0..inputs {
                for tap in 0..TAPS {
                    weights[((o / block * inputs + i) * TAPS + tap) * block + o % block] = weight(o, i, tap);
                }
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
    let of_band = |output| dispatch(isa, Convolve { input, packed, finish, output });
    if parts > 1 { bands.into_par_iter().for_each(of_band) } else { bands.into_iter().for_each(of_band) }
}

struct Convolve<'a> {
    input: &'a Planes,
    packed: &'a Packed,
    finish: Finish<'a>,
    output: Band<'a>,
}

impl Kernel for Convolve<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        if S::CONV_OUTPUTS == 8 {
            convolve_rows::<S, 8>(s, &mut self);
        } else {
            convolve_rows::<S, 4>(s, &mut self);
        }
    }
}

#[inline(always)]
fn convolve_rows<S: Simd, const OUTPUTS: usize>(s: S, work: &mut Convolve) {
    let g = work.input.geometry;
    for y in work.output.rows.clone() {
        let mut x = 0;
        while x < g.width {
            if x + S::LANES < g.width {
                convolve_at::<S, OUTPUTS, 2>(s, work, y, x);
                x += 2 * S::LANES;
            } else {
                convolve_at::<S, OUTPUTS, 1>(s, work, y, x);
                x += S::LANES;
            }
        }
        // Whole vectors were stored; what lies outside the picture must stay zero.
        let at = work.output.row(g, y);
        for channel in &mut work.output.channels {
            channel[at + g.width..at + x].fill(0.0);
        }
    }
}

/// `VECTORS` row vectors at (y, x), all output channels.
#[inline(always)]
fn convolve_at<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(s: S, work: &mut Convolve, y: usize, x: usize) {
    let Convolve { input, packed, finish, output } = work;
    let g = input.geometry;
    let plane = g.plane();
    let at = g.row(y) + x;
    let starts = [at - g.stride - 1, at - 1, at + g.stride - 1];
    let rows = InputRows { data: &input.data, starts, pitch: plane };
    let to = output.row(g, y) + x;
    for block in 0..MAX_CHANNELS / OUTPUTS {
        let sums = sums_of_block::<S, OUTPUTS, VECTORS>(s, packed, block, &rows);
        let first = block * OUTPUTS * plane + at;
        let channels = &mut output.channels[block * OUTPUTS..][..OUTPUTS];
        // Loops so short that they are unrolled: otherwise the sums would live in memory all along.
        match finish {
            Finish::Linear => store_channels(s, channels, to, sums),
            Finish::Relu => store_channels(s, channels, to, at_least(s, s.zero(), sums)),
            Finish::MaskedBy(mask) => {
                let mut masked = sums;
                for (o, sum) in masked.iter_mut().enumerate() {
                    for (k, v) in sum.iter_mut().enumerate() {
                        *v = s.where_positive(s.load(&mask.data[first + o * plane + k * S::LANES..]), *v);
                    }
                }
                store_channels(s, channels, to, masked);
            }
        }
    }
}

/// max(floor, ·) of every vector.
#[inline(always)]
pub(super) fn at_least<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(
    s: S,
    floor: S::F,
    mut values: [[S::F; VECTORS]; OUTPUTS],
) -> [[S::F; VECTORS]; OUTPUTS] {
    for values in &mut values {
        for v in values {
            *v = s.max(*v, floor);
        }
    }
    values
}

/// Writes the vectors of output channels, `plane` floats from one channel to the next.
#[inline(always)]
pub(super) fn store_block<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(
    s: S,
    output: &mut [f32],
    plane: usize,
    values: [[S::F; VECTORS]; OUTPUTS],
) {
    for (o, values) in values.into_iter().enumerate() {
        let to = &mut output[o * plane..][..VECTORS * S::LANES];
        for (k, v) in values.into_iter().enumerate() {
            s.store(&mut to[k * S::LANES..], v);
        }
    }
}

/// The same to channels that lie apart.
#[inline(always)]
fn store_channels<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(
    s: S,
    channels: &mut [&mut [f32]],
    at: usize,
    values: [[S::F; VECTORS]; OUTPUTS],
) {
    for (channel, values) in channels.iter_mut().zip(values) {
        let to = &mut channel[at..][..VECTORS * S::LANES];
        for (k, v) in values.into_iter().enumerate() {
            s.store(&mut to[k * S::LANES..], v);
        }
    }
}

/// What a row of outputs is computed from.
pub(super) struct InputRows<'a> {
    pub data: &'a [f32],
    /// Where the row above, the same and the one below begin in channel 0, one pixel left of the outputs'.
    pub starts: [usize; KERNEL],
    /// Floats from one channel to the next.
    pub pitch: usize,
}

/// Bias plus convolution of `VECTORS` row vectors, for the output channels of one block.
#[inline(always)]
pub(super) fn sums_of_block<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(
    s: S,
    packed: &Packed,
    block: usize,
    input: &InputRows,
) -> [[S::F; VECTORS]; OUTPUTS] {
    let mut sums = [[s.zero(); VECTORS]; OUTPUTS];
    for (o, sum) in sums.iter_mut().enumerate() {
        *sum = [s.splat(packed.bias[block * OUTPUTS + o]); VECTORS];
    }
    let (weights, _) = packed.weights.as_chunks::<OUTPUTS>();
    let weights = weights[block * packed.inputs * TAPS..][..packed.inputs * TAPS].as_chunks::<TAPS>().0;
    let end = (packed.inputs - 1) * input.pitch + VECTORS * S::LANES + KERNEL - 1;
    assert!(input.starts.iter().all(|start| start + end <= input.data.len()), "rows of the layer's inputs");
    for (i, weights) in weights.iter().enumerate() {
        for (row, start) in input.starts.into_iter().enumerate() {
            for column in 0..KERNEL {
                let mut v = [s.zero(); VECTORS];
                for (k, v) in v.iter_mut().enumerate() {
                    // SAFETY: i is an input, column < KERNEL and k < VECTORS, so the load ends at most at
                    // start + end, which was checked above.
                    *v = unsafe {
                        s.load_from(input.data.as_ptr().add(start + i * input.pitch + column + k * S::LANES))
                    };
                }
                for (sum, weight) in sums.iter_mut().zip(&weights[row * KERNEL + column]) {
                    let weight = s.splat(*weight);
                    for k in 0..VECTORS {
                        sum[k] = s.fma(weight, v[k], sum[k]);
                    }
                }
            }
        }
    }
    sums
}

/// Adds the gradient of one layer's kernel and bias to `gradient` (`[outputs][inputs][3][3]`, then
/// `[outputs]`), given the layer's input and the gradient of its output; inputs in as many parts at once as are asked for.
pub(super) fn weight_gradient(
    isa: Isa,
    input: &Planes,
    inputs: usize,
    upstream: &Planes,
    outputs: usize,
    gradient: &mut [f32],
    parts: usize,
) {
    assert_eq!(input.geometry, upstream.geometry, "planes of one geometry");
    assert_eq!(gradient.len(), outputs * (inputs * TAPS + 1), "gradient of the layer");
    assert!(input.channels >= inputs && upstream.channels == MAX_CHANNELS, "planes of the layer");
    let of = |range, gradient: &mut [f32]| {
        dispatch(isa, WeightGradient { input, inputs, range, upstream, outputs, gradient });
    };
    if parts <= 1 {
        return of(0..inputs, gradient);
    }
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

struct WeightGradient<'a> {
    input: &'a Planes,
    inputs: usize,
    /// The inputs whose weights are at hand; the bias comes with the first.
    range: Range<usize>,
    upstream: &'a Planes,
    outputs: usize,
    gradient: &'a mut [f32],
}

impl Kernel for WeightGradient<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) {
        if S::CONV_OUTPUTS == 8 {
            gradient_blocks::<S, 8>(s, &mut self);
        } else {
            gradient_blocks::<S, 4>(s, &mut self);
        }
        if self.range.start == 0 {
            bias_gradient(s, &mut self);
        }
    }
}

#[inline(always)]
fn gradient_blocks<S: Simd, const OUTPUTS: usize>(s: S, work: &mut WeightGradient) {
    for first in (0..work.outputs).step_by(OUTPUTS) {
        for i in work.range.clone() {
            for row in 0..KERNEL {
                let sums = gradient_sums::<S, OUTPUTS>(s, work, first, i, row);
                // Stored before they are summed: see `convolve_at`.
                let mut done = [0.0; 8 * KERNEL * MAX_LANES];
                for (o, sum) in sums.iter().enumerate() {
                    for (c, v) in sum.iter().enumerate() {
                        s.store(&mut done[(o * KERNEL + c) * S::LANES..], *v);
                    }
                }
                for o in 0..OUTPUTS.min(work.outputs - first) {
                    for c in 0..KERNEL {
                        let slot = ((first + o) * work.inputs + i) * TAPS + row * KERNEL + c;
                        work.gradient[slot] += s.sum(s.load(&done[(o * KERNEL + c) * S::LANES..]));
                    }
                }
            }
        }
    }
}

/// Lane by lane, the gradient of the weights of one row of the kernel, from input `i` to the outputs
/// from `first` on.
#[inline(always)]
fn gradient_sums<S: Simd, const OUTPUTS: usize>(
    s: S,
    work: &WeightGradient,
    first: usize,
    i: usize,
    row: usize,
) -> [[S::F; KERNEL]; OUTPUTS] {
    let g = work.input.geometry;
    let plane = g.plane();
    // Pixel (0, 0) of the outputs, and what the kernel's row begins with there.
    let upstream = &work.upstream.data[first * plane + g.row(0)..];
    let input = &work.input.data[i * plane + g.row(0) + row * g.stride - g.stride - 1..];
    let end = (g.height - 1) * g.stride + g.width.next_multiple_of(S::LANES);
    assert!(end + KERNEL - 1 <= input.len() && (OUTPUTS - 1) * plane + end <= upstream.len());
    let mut sums = [[s.zero(); KERNEL]; OUTPUTS];
    for y in 0..g.height {
        for x in (0..g.width).step_by(S::LANES) {
            let at = y * g.stride + x;
            // SAFETY: at + LANES <= end, and c < KERNEL and o < OUTPUTS: all loads lie before the ends that
            // were checked above.
            unsafe {
                let mut v = [s.zero(); KERNEL];
                for (c, v) in v.iter_mut().enumerate() {
                    *v = s.load_from(input.as_ptr().add(at + c));
                }
                for (o, sum) in sums.iter_mut().enumerate() {
                    let u = s.load_from(upstream.as_ptr().add(o * plane + at));
                    for c in 0..KERNEL {
                        sum[c] = s.fma(u, v[c], sum[c]);
                    }
                }
            }
        }
    }
    sums
}

#[inline(always)]
fn bias_gradient<S: Simd>(s: S, work: &mut WeightGradient) {
    let g = work.input.geometry;
    let bias = work.outputs * work.inputs * TAPS;
    for o in 0..work.outputs {
        let upstream = &work.upstream.data[o * g.plane() + g.row(0)..];
        let mut sum = s.zero();
        for y in 0..g.height {
            for x in (0..g.width).step_by(S::LANES) {
                sum = s.add(sum, s.load(&upstream[y * g.stride + x..]));
            }
        }
        work.gradient[bias + o] += s.sum(sum);
    }
}
