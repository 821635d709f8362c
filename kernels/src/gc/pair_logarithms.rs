//! What a pixel and its tap have in common: log2(1 + ‖y_c-y_i‖²) and log2(1 + ‖z_c-z_i‖²), most of
//! the arithmetic of a weight. They are computed once for both pixels of a pair.

use super::strip::{Row, STRIP, at_column};
use super::taps::{Pair, RowPairs};
use super::vector::{difference, load3, squared};
use crate::aligned::Aligned;
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
pub(super) struct Logarithms(Aligned);

impl Logarithms {
    pub(super) fn new(radius: usize) -> Self {
        Self(Aligned::zeros((2 * radius + 1) * 2 * LENGTH))
    }

    /// Those of the pixels from column `x` on: [`Tap::logs`] counts from here.
    pub(super) fn at_column(&self, x: usize) -> &[f32] {
        &self.0[x..]
    }

    /// Fills in what the pixels of the `upper` and `lower` row need that are `wanted`.
    #[inline(always)]
    pub(super) fn compute<S: Simd>(
        &mut self,
        s: S,
        taps: &RowTaps,
        [upper, lower]: [&Row; 2],
        wanted: [bool; 2],
        width: usize,
    ) {
        for (pair, logs) in taps.pairs.iter().zip(self.0.chunks_exact_mut(2 * LENGTH)) {
            let (right, left) = (pair.dx.max(0), (-pair.dx).max(0));
            let (down, up) = (pair.down && wanted[0], pair.up && wanted[1]);
            let width = width as isize;
            let range = match (down, up) {
                (true, true) => 0..width + right + left,
                (true, false) => right..right + width,
                (false, true) => left..left + width,
                (false, false) => continue,
            };
            let (of_radiance, of_denoised) = logs.split_at_mut(TO_DENOISED);
            for x in range.step_by(S::LANES) {
                let upper = at_column::<S>(upper, x - right);
                let lower = at_column::<S>(lower, x - right + pair.dx);
                s.store(&mut of_radiance[x as usize..], logarithm(s, upper, lower, RADIANCE));
                s.store(&mut of_denoised[x as usize..], logarithm(s, upper, lower, DENOISED));
            }
        }
    }
}

/// log2(1 + ‖a-b‖²) of the three planes from `channel` on.
#[inline(always)]
fn logarithm<S: Simd>(s: S, a: &[f32], b: &[f32], channel: usize) -> S::F {
    s.log2_1p(squared(s, &difference(s, &load3(s, a, channel), &load3(s, b, channel))))
}
