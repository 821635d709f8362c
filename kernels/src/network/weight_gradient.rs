//! The gradient of a layer's weights over a tile.
//!
//! For a block of output channels, an input and a point ([`points`](super::points)) the sums over all pixels stay in registers.

use super::conv::{MOST_OUTPUTS, TAPS};
use super::planes::{Geometry, Planes};
use super::points::{POINTS, Points, kernel_of_points};
use super::tile_convolution::each;
use super::{KERNEL, MAX_CHANNELS};
use crate::aligned::Aligned;
use crate::parts::in_parts;
use crate::simd::{Isa, Kernel, Simd, dispatch};
use rayon::prelude::*;
use std::ops::Range;

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

/// Inputs whose sums are kept until all points are there.
const INPUTS_AT_ONCE: usize = 4;

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
    // Sums of a block and some inputs: `[input][point][output][column]`, a vector each.
    let of_input = POINTS * OUTPUTS * KERNEL * S::LANES;
    let mut done = Aligned::zeros(INPUTS_AT_ONCE * of_input);
    for (first, start) in (0..work.outputs)
        .step_by(OUTPUTS)
        .flat_map(|first| work.range.clone().step_by(INPUTS_AT_ONCE).map(move |start| (first, start)))
    {
        let inputs = INPUTS_AT_ONCE.min(work.range.end - start);
        // One point of the block's outputs stays in the first cache for all of these inputs.
        for (m, i) in (0..POINTS).flat_map(|m| (0..inputs).map(move |i| (m, i))) {
            let sums = gradient_sums::<S, OUTPUTS>(s, work, first, start + i, m);
            let to = &mut done[i * of_input + m * OUTPUTS * KERNEL * S::LANES..];
            for (o, sum) in sums.iter().enumerate() {
                for (c, v) in sum.iter().enumerate() {
                    s.store(&mut to[(o * KERNEL + c) * S::LANES..], *v);
                }
            }
        }
        for (o, i, column) in each(OUTPUTS.min(work.outputs - first), inputs) {
            let mut sums = [s.zero(); POINTS];
            for (m, sum) in sums.iter_mut().enumerate() {
                *sum = s.load(&done[i * of_input + ((m * OUTPUTS + o) * KERNEL + column) * S::LANES..]);
            }
            for (row, v) in kernel_of_points(s, sums).into_iter().enumerate() {
                let slot = ((first + o) * work.inputs + start + i) * TAPS + row * KERNEL + column;
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
