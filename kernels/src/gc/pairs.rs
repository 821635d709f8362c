//! What a pixel and its tap have in common: log2(1 + ‖y_c-y_i‖²) and log2(1 + ‖z_c-z_i‖²), most of
//! the arithmetic of a weight. They are computed once for both pixels of a pair.

use super::strip::{Line, PITCH, STRIP, lines};
use super::taps::{Pair, RowPairs};
use super::vector::{difference, load3, squared};
use crate::features::{DENOISED, MAX_RADIUS, RADIANCE};
use crate::simd::{MAX_LANES, Simd};

/// Floats of one logarithm of one pair's dx.
const LENGTH: usize = (STRIP + MAX_RADIUS + MAX_LANES).next_multiple_of(MAX_LANES);
/// From the logarithm of y to that of z.
pub(super) const TO_DENOISED: usize = LENGTH;

/// One tap of all pixels of a row, and where its logarithms lie for the pixel in column 0.
#[derive(Clone, Copy)]
pub(super) struct Tap {
    pub dx: isize,
    pub logs: usize,
}

/// The taps of two rows of pixels in one another.
pub(super) struct RowTaps {
    pub dy: isize,
    pairs: Vec<Pair>,
    /// Taps in the lower row of pixels in the upper one.
    pub down: Vec<Tap>,
    /// Taps in the upper row of pixels in the lower one.
    pub up: Vec<Tap>,
}

impl RowTaps {
    pub(super) fn new(row: RowPairs) -> Self {
        let logs = |i: usize, skipped: isize| i * 2 * LENGTH + skipped.max(0) as usize;
        let pairs = || row.pairs.iter().enumerate();
        Self {
            dy: row.dy,
            down: pairs().filter(|(_, p)| p.down).map(|(i, p)| Tap { dx: p.dx, logs: logs(i, p.dx) }).collect(),
            up: pairs().filter(|(_, p)| p.up).map(|(i, p)| Tap { dx: -p.dx, logs: logs(i, -p.dx) }).collect(),
            pairs: row.pairs,
        }
    }
}

/// Logarithms of the pairs of two rows. A pair's stand from the first one on that a pixel of the
/// strip needs: for dx > 0 that is the lower row's first pixel, compared with one left of the strip.
pub(super) struct Logarithms(Vec<Line>);

impl Logarithms {
    pub(super) fn new(radius: usize) -> Self {
        Self(lines((2 * radius + 1) * 2 * LENGTH))
    }

    pub(super) fn at(&self, x: usize) -> *const f32 {
        self.0.as_ptr().cast::<f32>().wrapping_add(x)
    }

    /// Fills in what the pixels of the `upper` and `lower` row need that are `wanted`.
    ///
    /// # Safety
    /// The machine must have `S`; the rows must hold `width` columns and what their windows reach.
    #[inline(always)]
    pub(super) unsafe fn compute<S: Simd>(
        &mut self,
        taps: &RowTaps,
        [upper, lower]: [*const f32; 2],
        wanted: [bool; 2],
        width: usize,
    ) {
        unsafe {
            for (i, pair) in taps.pairs.iter().enumerate() {
                let (right, left) = (pair.dx.max(0) as usize, (-pair.dx).max(0) as usize);
                let (down, up) = (pair.down && wanted[0], pair.up && wanted[1]);
                let range = match (down, up) {
                    (true, true) => 0..width + right + left,
                    (true, false) => right..right + width,
                    (false, true) => left..left + width,
                    (false, false) => continue,
                };
                let logs = self.0.as_mut_ptr().cast::<f32>().add(i * 2 * LENGTH);
                let upper = upper.offset(-(right as isize));
                let lower = lower.offset(pair.dx - right as isize);
                for x in range.step_by(S::LANES) {
                    let (upper, lower) = (upper.add(x), lower.add(x));
                    S::store(logs.add(x), logarithm::<S>(upper, lower, RADIANCE));
                    S::store(logs.add(TO_DENOISED + x), logarithm::<S>(upper, lower, DENOISED));
                }
            }
        }
    }
}

/// log2(1 + ‖a-b‖²) of the three planes from `channel` on.
#[inline(always)]
unsafe fn logarithm<S: Simd>(a: *const f32, b: *const f32, channel: usize) -> S::F {
    unsafe {
        let (a, b) = (load3::<S>(a.add(channel * PITCH)), load3::<S>(b.add(channel * PITCH)));
        S::log2_1p(squared::<S>(&difference::<S>(&a, &b)))
    }
}
