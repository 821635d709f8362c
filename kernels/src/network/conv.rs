//! The three passes of a 3x3 convolution over padded planes: forward, gradient of the input (the
//! forward pass with turned and transposed weights) and gradient of the weights.
//!
//! Rows are vectorised; a block of output channels and two row vectors stay in registers, so each
//! weight is broadcast once for two multiply-adds and each input vector is loaded once for a block.

use super::planes::{Geometry, Planes};
use super::{KERNEL, MAX_CHANNELS};
use crate::simd::{Isa, Kernel, MAX_LANES, Simd, dispatch};

pub(super) const TAPS: usize = KERNEL * KERNEL;

/// Weights of one layer in the order the kernel reads them: `[output block][input][tap][block]`.
pub(super) struct Packed {
    weights: Vec<f32>,
    bias: [f32; MAX_CHANNELS],
    inputs: usize,
}

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

    /// `[output block][input][tap][block]`
    pub fn weights(&self) -> &[f32] {
        &self.weights
    }

    pub fn bias(&self) -> &[f32; MAX_CHANNELS] {
        &self.bias
    }

    /// Input channels.
    pub fn inputs(&self) -> usize {
        self.inputs
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

/// `output = finish(conv(input) + bias)`, all sixteen output planes.
pub(super) fn convolve(isa: Isa, input: &Planes, packed: &Packed, finish: Finish, output: &mut Planes) {
    assert_eq!(input.geometry, output.geometry, "planes of one geometry");
    assert!(input.channels >= packed.inputs && output.channels == MAX_CHANNELS, "planes of the layer");
    if let Finish::MaskedBy(mask) = finish {
        assert!(mask.geometry == output.geometry && mask.channels == MAX_CHANNELS, "mask of the layer");
    }
    dispatch(isa, Convolve { input, packed, finish, output });
}

struct Convolve<'a> {
    input: &'a Planes,
    packed: &'a Packed,
    finish: Finish<'a>,
    output: &'a mut Planes,
}

impl Kernel for Convolve<'_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<S: Simd>(self) {
        // SAFETY: `convolve` checked that all planes share one geometry, whose padding covers the
        // loads at x - 1 and x + LANES and the stores up to the next multiple of MAX_LANES.
        unsafe {
            if S::CONV_OUTPUTS == 8 {
                convolve_rows::<S, 8>(self);
            } else {
                convolve_rows::<S, 4>(self);
            }
        }
    }
}

/// Ones for the pixels of a row, zeros from its end on: `[i]` is the mask of a vector that has
/// `MAX_LANES - i` pixels left.
static LANE_MASK: [f32; 2 * MAX_LANES] = {
    let mut mask = [0.0; 2 * MAX_LANES];
    let mut i = 0;
    while i < MAX_LANES {
        mask[i] = 1.0;
        i += 1;
    }
    mask
};

#[inline(always)]
unsafe fn convolve_rows<S: Simd, const OUTPUTS: usize>(work: Convolve) {
    unsafe {
        let g = work.input.geometry;
        for y in 0..g.height {
            let mut x = 0;
            while x < g.width {
                if x + S::LANES < g.width {
                    convolve_at::<S, OUTPUTS, 2>(
                        &work.input.data,
                        work.packed,
                        work.finish,
                        work.output.data.as_mut_ptr(),
                        g,
                        y,
                        x,
                    );
                    x += 2 * S::LANES;
                } else {
                    convolve_at::<S, OUTPUTS, 1>(
                        &work.input.data,
                        work.packed,
                        work.finish,
                        work.output.data.as_mut_ptr(),
                        g,
                        y,
                        x,
                    );
                    x += S::LANES;
                }
            }
        }
    }
}

/// `VECTORS` row vectors at (y, x), all output channels.
#[inline(always)]
unsafe fn convolve_at<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(
    input: &[f32],
    packed: &Packed,
    finish: Finish,
    output: *mut f32,
    g: Geometry,
    y: usize,
    x: usize,
) {
    unsafe {
        let plane = g.plane();
        let at = g.row(y) + x;
        // The pixel up and to the left.
        let corner = input.as_ptr().add(at - g.stride - 1);
        for block in 0..MAX_CHANNELS / OUTPUTS {
            let first = block * OUTPUTS;
            let mut sums: [[S::F; VECTORS]; OUTPUTS] =
                std::array::from_fn(|o| [S::splat(packed.bias[first + o]); VECTORS]);
            let mut w = packed.weights.as_ptr().add(block * packed.inputs * TAPS * OUTPUTS);
            for i in 0..packed.inputs {
                for row in 0..KERNEL {
                    let p = corner.add(i * plane + row * g.stride);
                    for column in 0..KERNEL {
                        let v: [S::F; VECTORS] = std::array::from_fn(|k| S::load(p.add(column + k * S::LANES)));
                        for (o, sum) in sums.iter_mut().enumerate() {
                            let weight = S::splat(*w.add(o));
                            for k in 0..VECTORS {
                                sum[k] = S::fma(weight, v[k], sum[k]);
                            }
                        }
                        w = w.add(OUTPUTS);
                    }
                }
            }
            // Indexed by a loop that is not unrolled, the sums would have to live in memory all along.
            let mut done = [0.0f32; 2 * 8 * MAX_LANES];
            for (o, sum) in sums.iter().enumerate() {
                for (k, v) in sum.iter().enumerate() {
                    S::store(done.as_mut_ptr().add((k * OUTPUTS + o) * S::LANES), *v);
                }
            }
            for k in 0..VECTORS {
                let begin = x + k * S::LANES;
                let left = g.width.saturating_sub(begin).min(MAX_LANES);
                let inside = S::load(LANE_MASK.as_ptr().add(MAX_LANES - left));
                for o in 0..OUTPUTS {
                    let offset = (first + o) * plane + at + k * S::LANES;
                    let sum = S::load(done.as_ptr().add((k * OUTPUTS + o) * S::LANES));
                    let value = match finish {
                        Finish::Linear => sum,
                        Finish::Relu => S::max(sum, S::zero()),
                        Finish::MaskedBy(mask) => S::where_positive(S::load(mask.data.as_ptr().add(offset)), sum),
                    };
                    S::store(
                        output.add(offset),
                        if left < S::LANES { S::where_positive(inside, value) } else { value },
                    );
                }
            }
        }
    }
}

/// Adds the gradient of one layer's kernel and bias to `gradient` (`[outputs][inputs][3][3]`, then
/// `[outputs]`), given the layer's input and the gradient of its output.
pub(super) fn weight_gradient(
    isa: Isa,
    input: &Planes,
    inputs: usize,
    upstream: &Planes,
    outputs: usize,
    gradient: &mut [f32],
) {
    assert_eq!(input.geometry, upstream.geometry, "planes of one geometry");
    assert_eq!(gradient.len(), outputs * (inputs * TAPS + 1), "gradient of the layer");
    assert!(input.channels >= inputs && upstream.channels == MAX_CHANNELS, "planes of the layer");
    dispatch(isa, WeightGradient { input, inputs, upstream, outputs, gradient });
}

struct WeightGradient<'a> {
    input: &'a Planes,
    inputs: usize,
    upstream: &'a Planes,
    outputs: usize,
    gradient: &'a mut [f32],
}

impl Kernel for WeightGradient<'_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<S: Simd>(self) {
        // SAFETY: as in `Convolve::run`; both planes share one geometry.
        unsafe {
            if S::CONV_OUTPUTS == 8 {
                gradient_blocks::<S, 8>(self);
            } else {
                gradient_blocks::<S, 4>(self);
            }
        }
    }
}

#[inline(always)]
unsafe fn gradient_blocks<S: Simd, const OUTPUTS: usize>(work: WeightGradient) {
    unsafe {
        let g = work.input.geometry;
        let plane = g.plane();
        for first in (0..work.outputs).step_by(OUTPUTS) {
            let upstream = work.upstream.data.as_ptr().add(first * plane + g.row(0));
            for i in 0..work.inputs {
                for row in 0..KERNEL {
                    let input = work.input.data.as_ptr().add(i * plane + g.row(0) + row * g.stride - g.stride - 1);
                    let mut sums: [[S::F; KERNEL]; OUTPUTS] = [[S::zero(); KERNEL]; OUTPUTS];
                    for y in 0..g.height {
                        for x in (0..g.width).step_by(S::LANES) {
                            let at = y * g.stride + x;
                            let v: [S::F; KERNEL] = std::array::from_fn(|c| S::load(input.add(at + c)));
                            for (o, sum) in sums.iter_mut().enumerate() {
                                let u = S::load(upstream.add(o * plane + at));
                                for c in 0..KERNEL {
                                    sum[c] = S::fma(u, v[c], sum[c]);
                                }
                            }
                        }
                    }
                    let mut done = [0.0; 8 * KERNEL];
                    for (o, sum) in sums.iter().enumerate() {
                        for (c, v) in sum.iter().enumerate() {
                            done[o * KERNEL + c] = S::sum(*v);
                        }
                    }
                    for o in 0..OUTPUTS.min(work.outputs - first) {
                        for c in 0..KERNEL {
                            let slot = ((first + o) * work.inputs + i) * TAPS + row * KERNEL + c;
                            work.gradient[slot] += done[o * KERNEL + c];
                        }
                    }
                }
            }
        }
        let bias = work.outputs * work.inputs * TAPS;
        for o in 0..work.outputs {
            let mut sum = S::zero();
            let upstream = work.upstream.data.as_ptr().add(o * plane + g.row(0));
            for y in 0..g.height {
                for x in (0..g.width).step_by(S::LANES) {
                    sum = S::add(sum, S::load(upstream.add(y * g.stride + x)));
                }
            }
            work.gradient[bias + o] += S::sum(sum);
        }
    }
}
