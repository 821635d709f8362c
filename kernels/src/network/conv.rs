//! A 3x3 convolution of rows, as pictures are streamed through a network ([`super::rows`]).
//!
//! Rows are vectorised; a block of output channels and some row vectors stay in registers, so each
//! weight is broadcast once for all of these vectors and each input vector is loaded once for a block.

use super::{KERNEL, MAX_CHANNELS};
use crate::simd::{Isa, Simd};

pub(super) const TAPS: usize = KERNEL * KERNEL;

/// Output channels whose sums are in registers where these are many.
pub(super) const MOST_OUTPUTS: usize = 8;

/// Weights of one layer in the order the kernel reads them: `[output block][input][tap][block]`.
pub(super) struct Packed {
    weights: Vec<f32>,
    bias: [f32; MAX_CHANNELS],
    inputs: usize,
}

/// [`Simd::CONV_OUTPUTS`] of the instruction set.
pub(super) fn block_of(isa: Isa) -> usize {
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
