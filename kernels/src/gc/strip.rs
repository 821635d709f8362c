//! Rows of a strip of a picture, close together.
//!
//! 361 taps read every feature plane of every row, so a row is copied once to where constant
//! distances lead from plane to plane and the rows of a window stay in the first caches.

use crate::aligned::Aligned;
use crate::features::{ALBEDO, FEATURE_CHANNELS, MAX_RADIUS};
use crate::region::Region;
use crate::simd::{MAX_LANES, Simd};
use crate::windows::Windows;

/// Widest strip of a picture, pixels, which is computed by itself: rows and sums fit the first cache, and so do the distances of a
/// pair of rows in windows of 13x13; those of 19x19 take 36 KiB.
pub const STRIP: usize = 64;
/// Where the strip's first column lies in a copied plane: on a cache line.
pub(super) const LEFT: usize = MAX_RADIUS.next_multiple_of(MAX_LANES);
/// Floats from one plane of a copied row to the next.
pub(super) const PITCH: usize = (LEFT + STRIP + MAX_RADIUS + MAX_LANES).next_multiple_of(MAX_LANES);
/// All features, and the mask of missing pixels.
const ROW: usize = (FEATURE_CHANNELS + 1) * PITCH;

/// One copied row: [`PITCH`] floats of every plane.
pub(super) type Row = [f32; ROW];

/// The planes of a row from column `x` (which may lie outside the strip) on.
#[inline(always)]
pub(super) fn at_column<S: Simd>(row: &Row, x: isize) -> &[f32] {
    at_columns::<S>(row, x, 1)
}

/// The same for so many vectors side by side.
#[inline(always)]
pub(super) fn at_columns<S: Simd>(row: &Row, x: isize, vectors: usize) -> &[f32] {
    &row[LEFT.wrapping_add_signed(x)..][..FEATURE_CHANNELS * PITCH + vectors * S::LANES]
}

/// The rows that a row of pixels is compared with, itself included, as a ring.
pub(super) struct Rows {
    data: Aligned,
    radius: usize,
}

impl Rows {
    pub(super) fn new(radius: usize) -> Self {
        Self { data: Aligned::zeros((radius + 1) * ROW), radius }
    }

    /// Copies row `y` (from -radius on) of a strip, its radiance and its other features, with all that its windows reach to either
    /// side.
    pub(super) fn copy(&mut self, radiance: &Windows, guides: &Windows, strip: &Region, y: isize) {
        let radius = self.radius;
        // The padding of `Windows` holds the taps of a vector that starts in the last column.
        let count = strip.width + 2 * radius + MAX_LANES;
        let row = (strip.top + guides.radius()).strict_add_signed(y);
        let from = row * guides.stride() + strip.left + guides.radius() - radius;
        let at = self.slot(y) * ROW + LEFT - radius;
        for c in 0..FEATURE_CHANNELS + usize::from(guides.masked()) {
            let planes = if c < ALBEDO { radiance } else { guides };
            let source = &planes.data()[c * guides.plane() + from..][..count];
            self.data[at + c * PITCH..][..count].copy_from_slice(source);
        }
    }

    /// Row `y`.
    pub(super) fn row(&self, y: isize) -> &Row {
        let rows = self.data.as_chunks().0;
        &rows[self.slot(y)]
    }

    fn slot(&self, y: isize) -> usize {
        (y + self.radius as isize) as usize % (self.radius + 1)
    }
}
