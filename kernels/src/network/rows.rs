//! The network streamed over the rows of a window: as soon as a layer has three rows, the next layer
//! computes one.
//!
//! Each layer keeps its last three rows only, so what is read again and again stays in the core's
//! cache however large the window is, and rows that the wanted part does not depend on are never
//! computed.

use super::conv::{Packed, TAPS};
use super::{KERNEL, MAX_CHANNELS};
use crate::region::Region;
use crate::simd::{Isa, Kernel, MAX_LANES, Simd, dispatch};

/// Zeros to the left of every row; the vector loads at x - 1 land here.
const LEFT: usize = MAX_LANES;
/// Room to the right of a row for whole vectors and the loads at x + 1.
const RIGHT: usize = 4 * MAX_LANES;

/// The last three rows of one layer's output, all channels of a row together, and a row of zeros.
struct Ring {
    data: Vec<f32>,
    stride: usize,
}

impl Ring {
    fn new(width: usize) -> Self {
        let stride = LEFT + width.next_multiple_of(MAX_LANES) + RIGHT;
        Self { data: vec![0.0; (KERNEL + 1) * MAX_CHANNELS * stride], stride }
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
            let from = inner.left.saturating_sub(reach);
            let to = (inner.left + inner.width + reach).min(width);
            let (before, after) = rings.split_at_mut(l + 1);
            let rectify = reach > 0;
            convolve_row(isa, &before[l], y, height, packed, rectify, from..to, width, &mut after[0]);
            if !rectify {
                for c in 0..outputs {
                    let row = &after[0].row_mut(y, c)[from..to];
                    out[(c * inner.height + y - inner.top) * inner.width..][..inner.width].copy_from_slice(row);
                }
            }
        }
    }
}

/// One row of one layer, the pixels `columns` (and some to their right that nobody reads).
#[allow(clippy::too_many_arguments)] // the kernel's operands, named once
fn convolve_row(
    isa: Isa,
    input: &Ring,
    y: usize,
    height: usize,
    packed: &Packed,
    rectify: bool,
    columns: std::ops::Range<usize>,
    width: usize,
    output: &mut Ring,
) {
    assert!(columns.end <= width && width + LEFT + RIGHT <= input.stride && input.stride == output.stride);
    let y0 = y as isize;
    let rows = [y0 - 1, y0, y0 + 1].map(|row| input.slot(row, height) + LEFT);
    let to = output.slot(y0, height) + LEFT;
    let (from, end) = (columns.start, columns.end);
    dispatch(
        isa,
        ConvolveRow {
            input: &input.data,
            rows,
            packed,
            rectify,
            from,
            end,
            stride: input.stride,
            to,
            output: &mut output.data,
        },
    );
    // Whole vectors were stored; the pixel right of the window must stay zero for the next layer.
    for c in 0..MAX_CHANNELS {
        output.row_mut(y, c)[width] = 0.0;
    }
}

struct ConvolveRow<'a> {
    input: &'a [f32],
    /// Where pixel 0 of channel 0 of the three rows lies.
    rows: [usize; KERNEL],
    packed: &'a Packed,
    rectify: bool,
    from: usize,
    end: usize,
    stride: usize,
    /// Where pixel 0 of channel 0 of the output row lies.
    to: usize,
    output: &'a mut [f32],
}

impl Kernel for ConvolveRow<'_> {
    type Output = ();

    #[inline(always)]
    unsafe fn run<S: Simd>(self) {
        // SAFETY: `convolve_row` checked that the columns lie in the window and that both rings have
        // rows of one stride with LEFT floats before pixel 0 and RIGHT after the last: the loads
        // from x - 1 on and the stores of up to three vectors stay inside the row.
        unsafe {
            if S::CONV_OUTPUTS == 8 {
                columns::<S, 8, 3>(self);
            } else {
                columns::<S, 4, 2>(self);
            }
        }
    }
}

#[inline(always)]
unsafe fn columns<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(mut work: ConvolveRow) {
    unsafe {
        let mut x = work.from;
        while x < work.end {
            let vectors = (work.end - x).div_ceil(S::LANES);
            if vectors >= VECTORS {
                pixels::<S, OUTPUTS, VECTORS>(&mut work, x);
                x += VECTORS * S::LANES;
            } else if vectors == 2 {
                pixels::<S, OUTPUTS, 2>(&mut work, x);
                x += 2 * S::LANES;
            } else {
                pixels::<S, OUTPUTS, 1>(&mut work, x);
                x += S::LANES;
            }
        }
    }
}

/// `VECTORS` row vectors from pixel `x` on, all output channels.
#[inline(always)]
unsafe fn pixels<S: Simd, const OUTPUTS: usize, const VECTORS: usize>(work: &mut ConvolveRow, x: usize) {
    unsafe {
        let floor = if work.rectify { S::zero() } else { S::splat(f32::NEG_INFINITY) };
        for block in 0..MAX_CHANNELS / OUTPUTS {
            let first = block * OUTPUTS;
            let bias = work.packed.bias();
            let mut sums: [[S::F; VECTORS]; OUTPUTS] = std::array::from_fn(|o| [S::splat(bias[first + o]); VECTORS]);
            let inputs = work.packed.inputs();
            let mut w = work.packed.weights().as_ptr().add(block * inputs * TAPS * OUTPUTS);
            for i in 0..inputs {
                for row in work.rows {
                    let p = work.input.as_ptr().add(row + i * work.stride + x - 1);
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
            let to = work.output.as_mut_ptr().add(work.to + first * work.stride + x);
            for (o, sum) in sums.iter().enumerate() {
                for (k, v) in sum.iter().enumerate() {
                    S::store(to.add(o * work.stride + k * S::LANES), S::max(*v, floor));
                }
            }
        }
    }
}
