//! Rows of a strip of a picture, close together.
//!
//! 361 taps read every feature plane of every row, so a row is copied once to where constant
//! distances lead from plane to plane and the rows of a window stay in the first caches.

use crate::features::{FEATURE_CHANNELS, MAX_RADIUS};
use crate::region::Region;
use crate::simd::MAX_LANES;
use crate::windows::Windows;

/// Widest strip: rows, sums and logarithms of a pair of rows fit the first cache together.
pub(super) const STRIP: usize = 64;
/// Where the strip's first column lies in a copied plane: on a cache line.
const LEFT: usize = MAX_RADIUS.next_multiple_of(MAX_LANES);
/// Floats from one plane of a copied row to the next.
pub(super) const PITCH: usize = (LEFT + STRIP + MAX_RADIUS + MAX_LANES).next_multiple_of(MAX_LANES);
/// All features, and the mask of missing pixels.
const ROW: usize = (FEATURE_CHANNELS + 1) * PITCH;

/// Floats in whole cache lines.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Line {
    _floats: [f32; MAX_LANES],
}

/// Zeros for `floats` floats.
pub(super) fn lines(floats: usize) -> Vec<Line> {
    vec![Line { _floats: [0.0; MAX_LANES] }; floats.div_ceil(MAX_LANES)]
}

/// The rows that a row of pixels is compared with, itself included, as a ring.
pub(super) struct Rows {
    data: Vec<Line>,
    radius: usize,
}

impl Rows {
    pub(super) fn new(radius: usize) -> Self {
        Self { data: lines((radius + 1) * ROW), radius }
    }

    /// Copies row `y` (from -radius on) of a strip with all that its windows reach to either side.
    pub(super) fn copy(&mut self, windows: &Windows, strip: &Region, y: isize) {
        let radius = self.radius;
        // The padding of `Windows` holds the taps of a vector that starts in the last column.
        let count = strip.width + 2 * radius + MAX_LANES;
        let row = (strip.top + windows.radius()).strict_add_signed(y);
        let from = row * windows.stride() + strip.left + windows.radius() - radius;
        let at = self.slot(y) * ROW + LEFT - radius;
        for c in 0..FEATURE_CHANNELS + usize::from(windows.masked()) {
            let source = &windows.data()[c * windows.plane() + from..][..count];
            self.floats_mut()[at + c * PITCH..][..count].copy_from_slice(source);
        }
    }

    /// Column 0 of the first plane of row `y`.
    pub(super) fn at(&self, y: isize) -> *const f32 {
        self.data.as_ptr().cast::<f32>().wrapping_add(self.slot(y) * ROW + LEFT)
    }

    fn slot(&self, y: isize) -> usize {
        (y + self.radius as isize) as usize % (self.radius + 1)
    }

    fn floats_mut(&mut self) -> &mut [f32] {
        // SAFETY: a `Line` is MAX_LANES floats and nothing else.
        unsafe { std::slice::from_raw_parts_mut(self.data.as_mut_ptr().cast(), self.data.len() * MAX_LANES) }
    }
}
