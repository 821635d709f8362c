//! Planes with a border of zeros, so that a 3x3 convolution needs no special case at the edge.

use super::MAX_CHANNELS;
use crate::aligned::Aligned;
use crate::parts::in_parts;
use crate::simd::MAX_LANES;
use std::ops::Range;

/// Zeros to the left of every row; the vector loads at x - 1 land here.
const LEFT: usize = 8;

/// Sizes of a padded plane of `height` x `width` pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Geometry {
    pub height: usize,
    pub width: usize,
    /// Floats from one row to the next.
    pub stride: usize,
}

impl Geometry {
    pub fn new(height: usize, width: usize) -> Self {
        Self { height, width, stride: width.next_multiple_of(MAX_LANES) + 2 * LEFT }
    }

    /// Floats of one plane, with a row of zeros above and below.
    pub fn plane(&self) -> usize {
        (self.height + 2) * self.stride
    }

    /// Where pixel (y, 0) lies in its plane.
    pub fn row(&self, y: usize) -> usize {
        (y + 1) * self.stride + LEFT
    }
}

/// `channels` padded planes. What lies outside the picture is zero at all times.
#[derive(Debug)]
pub(super) struct Planes {
    pub geometry: Geometry,
    pub channels: usize,
    pub data: Aligned,
}

impl Planes {
    pub fn zeros(geometry: Geometry, channels: usize) -> Self {
        Self { geometry, channels, data: Aligned::zeros(channels * geometry.plane()) }
    }

    /// Copies planar samples into the first planes.
    pub fn fill(&mut self, samples: &[f32]) {
        let Geometry { height, width, .. } = self.geometry;
        assert!(samples.len() <= self.channels * height * width, "planar samples");
        for (row, source) in samples.chunks_exact(width).enumerate() {
            let (c, y) = (row / height, row % height);
            let start = c * self.geometry.plane() + self.geometry.row(y);
            self.data[start..start + width].copy_from_slice(source);
        }
    }

    /// Copies the first `out.len() / (height * width)` planes out.
    pub fn copy_to(&self, out: &mut [f32]) {
        let Geometry { height, width, .. } = self.geometry;
        for (row, target) in out.chunks_exact_mut(width).enumerate() {
            let (c, y) = (row / height, row % height);
            let start = c * self.geometry.plane() + self.geometry.row(y);
            target.copy_from_slice(&self.data[start..start + width]);
        }
    }
}

/// Some rows of all sixteen planes, to be written.
pub(super) struct Band<'a> {
    /// The rows.
    pub rows: Range<usize>,
    /// Each plane from the beginning of the first row to the end of the last, zeros at their sides included.
    pub channels: [&'a mut [f32]; MAX_CHANNELS],
}

impl Band<'_> {
    /// Where pixel (y, 0) lies in a channel.
    #[inline(always)]
    pub fn row(&self, geometry: Geometry, y: usize) -> usize {
        (y - self.rows.start) * geometry.stride + LEFT
    }
}

impl Planes {
    /// The rows of sixteen planes in at most `parts` bands.
    pub fn bands(&mut self, parts: usize) -> Vec<Band<'_>> {
        let g = self.geometry;
        let ranges = in_parts(g.height, parts);
        let mut bands: Vec<Band> = ranges
            .into_iter()
            .map(|rows| Band { rows, channels: std::array::from_fn(|_| Default::default()) })
            .collect();
        for (c, plane) in self.data.chunks_exact_mut(g.plane()).enumerate().take(MAX_CHANNELS) {
            // Without the row of zeros above.
            let mut rest = &mut plane[g.stride..];
            for band in &mut bands {
                let (own, below) = rest.split_at_mut(band.rows.len() * g.stride);
                band.channels[c] = own;
                rest = below;
            }
        }
        bands
    }
}
