//! The network streamed over the rows of a window: as soon as a layer has three rows, the next layer
//! computes one.
//!
//! Each layer keeps its last three rows only, so what is read again and again stays in the core's
//! cache however large the window is, and rows that the wanted part does not depend on are never
//! computed.

use super::conv::{InputRows, Packed, at_least, store_block, sums_of_block};
use super::{KERNEL, MAX_CHANNELS};
use crate::aligned::Aligned;
use crate::region::Region;
use crate::simd::{Isa, Kernel, MAX_LANES, Simd, dispatch};
use std::ops::Range;

/// Zeros to the left of every row; the vector loads at x - 1 land here.
const LEFT: usize = MAX_LANES;
/// Room to the right of a row for whole vectors and the loads at x + 1.
const RIGHT: usize = 4 * MAX_LANES;

/// The last three rows of one layer's output, all channels of a row together, and a row of zeros.
struct Ring {
    data: Aligned,
    stride: usize,
}

impl Ring {
    fn new(width: usize) -> Self {
        let stride = LEFT + width.next_multiple_of(MAX_LANES) + RIGHT;
        Self { data: Aligned::zeros((KERNEL + 1) * MAX_CHANNELS * stride), stride }
    }

    /// Where row `y` of a window of `height` rows lies; outside of it, the zeros.
    fn slot(&self, y: isize, height: usize) -> usize {
        let inside = (0..height as isize).contains(&y);
        let slot = if inside { y as usize % KERNEL } else { KERNEL };
        slot * MAX_CHANNELS * self.stride
    }

    /// Channel `c` of row `y`, from pixel 0 on.
    fn row_mut(&mut self, y: usize, c: usize) -> &mut [f32] {
        let start = y % KERNEL * MAX_CHANNELS * self.stride + c * self.stride + LEFT;
        let length = self.stride - LEFT;
        &mut self.data[start..start + length]
    }
}

/// Outputs before activation of the pixels `inner` of a window, `[P, inner.height, inner.width]`.
/// `features` are `[C, height, width]`; around the window there are zeros.
pub(super) fn run(
    isa: Isa,
    layers: &[Packed],
    features: &[f32],
    height: usize,
    width: usize,
    inner: Region,
    out: &mut [f32],
) {
    let outputs = out.len() / inner.pixels();
    let mut rings: Vec<Ring> = (0..=layers.len()).map(|_| Ring::new(width)).collect();
    let inputs = features.len() / (height * width);
    // Layer l works on row step - 1 - l, when row step has just come in.
    for step in 0..height + layers.len() {
        if step < height {
            for c in 0..inputs {
                let source = &features[(c * height + step) * width..][..width];
                rings[0].row_mut(step, c)[..width].copy_from_slice(source);
            }
        }
        for (l, packed) in layers.iter().enumerate() {
            let Some(y) = (step).checked_sub(1 + l) else { break };
            // Pixels around the wanted ones that the layers after this one look at.
            let reach = layers.len() - 1 - l;
            let rows = inner.top.saturating_sub(reach)..(inner.top + inner.height + reach).min(height);
            if !rows.contains(&y) {
                continue;
            }
            let columns = inner.left.saturating_sub(reach)..(inner.left + inner.width + reach).min(width);
            let (before, after) = rings.split_at_mut(l + 1);
            let (input, output) = (&before[l], &mut after[0]);
            let rectify = reach > 0;
            ConvolveRow { packed, rectify, input, y, height, width, columns: columns.clone(), output }.run(isa);
            if !rectify {
                for c in 0..outputs {
                    let row = &after[0].row_mut(y, c)[columns.clone()];
                    out[(c * inner.height + y - inner.top) * inner.width..][..inner.width].copy_from_slice(row);
                }
            }
        }
    }
}

/// One row of one layer.
struct ConvolveRow<'a> {
    packed: &'a Packed,
    /// max(0, ·) of the sums.
    rectify: bool,
    input: &'a Ring,
    y: usize,
    height: usize,
    width: usize,
    /// The pixels wanted (some to their right are computed too).
    columns: Range<usize>,
    output: &'a mut Ring,
}

impl ConvolveRow<'_> {
    fn run(self, isa: Isa) {
        let Self { y, width, .. } = self;
        assert!(self.columns.end <= width, "columns of the window");
        let output = dispatch(isa, self);
        // Whole vectors were stored; the pixel right of the window must stay zero for the next layer.
        for c in 0..MAX_CHANNELS {
            output.row_mut(y, c)[width] = 0.0;
        }
    }
}

impl<'a> Kernel for ConvolveRow<'a> {
    type Output = &'a mut Ring;

    #[inline(always)]
    fn run<S: Simd>(mut self, s: S) -> &'a mut Ring {
        if S::CONV_OUTPUTS == 8 {
            convolve_columns::<S, 8, 3>(s, &mut self);
        } else {
            convolve_columns::<S, 4, 2>(s, &mut self);
        }
        self.output
    }
}

#[inline(always)]
fn convolve_columns<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(s: S, work: &mut ConvolveRow) {
    let mut x = work.columns.start;
    while x < work.columns.end {
        let vectors = (work.columns.end - x).div_ceil(S::LANES);
        if vectors >= VECTORS {
            convolve_at::<S, OUTPUTS, VECTORS>(s, work, x);
            x += VECTORS * S::LANES;
        } else if vectors == 2 {
            convolve_at::<S, OUTPUTS, 2>(s, work, x);
            x += 2 * S::LANES;
        } else {
            convolve_at::<S, OUTPUTS, 1>(s, work, x);
            x += S::LANES;
        }
    }
}

/// `VECTORS` row vectors from pixel `x` on, all output channels.
#[inline(always)]
fn convolve_at<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(s: S, work: &mut ConvolveRow, x: usize) {
    let ConvolveRow { packed, rectify, input, y, height, output, .. } = work;
    let floor = if *rectify { s.zero() } else { s.splat(f32::NEG_INFINITY) };
    let y = *y as isize;
    let starts = [y - 1, y, y + 1].map(|row| input.slot(row, *height) + LEFT + x - 1);
    let rows = InputRows { data: &input.data, starts, pitch: input.stride };
    for block in 0..MAX_CHANNELS / OUTPUTS {
        let sums = sums_of_block::<S, OUTPUTS, VECTORS>(s, packed, block, &rows);
        let to = output.slot(y, *height) + block * OUTPUTS * output.stride + LEFT + x;
        store_block(s, &mut output.data[to..], output.stride, at_least(s, floor, sums));
    }
}
