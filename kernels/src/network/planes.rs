//! Planes with a border of zeros, so that a 3x3 convolution needs no special case at the edge.

use super::MAX_CHANNELS;
use crate::aligned::Aligned;
use crate::parts::in_parts;
use crate::simd::MAX_LANES;
use std::ops::Range;

/// Zeros to the left of every row, which are those to the right of the row above; the vector loads at x - 1 and x + 1 land here.
/// A whole cache line: rows that begin elsewhere, so that every store straddles two, cost AVX-512 a quarter of its speed.
pub(super) const LEFT: usize = MAX_LANES;
/// Rows that the convolutions of a tile compute together.
pub(super) const GROUP: usize = 4;

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
        Self { height, width, stride: width.next_multiple_of(MAX_LANES) + LEFT }
    }

    /// Groups of rows, the last one filled up with zeros.
    pub fn groups(&self) -> usize {
        self.height.div_ceil(GROUP)
    }

    /// Floats of one plane of whole groups, with a row of zeros above and below, and zeros to the right of the last row.
    pub fn plane(&self) -> usize {
        (self.groups() * GROUP + 2) * self.stride + LEFT
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

/// Some groups of rows of all sixteen planes, to be written.
pub(super) struct Band<'a> {
    /// The groups.
    pub groups: Range<usize>,
    /// Each plane from the beginning of the first row to the end of the last, zeros at their sides included.
    pub channels: [&'a mut [f32]; MAX_CHANNELS],
}

impl Band<'_> {
    /// Where pixel (y, 0) lies in a channel.
    #[inline(always)]
    pub fn row(&self, geometry: Geometry, y: usize) -> usize {
        (y - self.groups.start * GROUP) * geometry.stride + LEFT
    }

    /// Zeros right of the picture up to column `end`, and below it, in the rows of a group.
    #[inline(always)]
    pub fn clear_outside(&mut self, geometry: Geometry, group: usize, end: usize) {
        for y in group * GROUP..(group + 1) * GROUP {
            let (at, inside) = (self.row(geometry, y), if y < geometry.height { geometry.width } else { 0 });
            for channel in &mut self.channels {
                channel[at + inside..at + end].fill(0.0);
            }
        }
    }
}

impl Planes {
    /// The groups of rows of sixteen planes in at most `parts` bands.
    pub fn bands(&mut self, parts: usize) -> Vec<Band<'_>> {
        let g = self.geometry;
        let mut bands: Vec<Band> = in_parts(g.groups(), parts)
            .into_iter()
            .map(|groups| Band { groups, channels: std::array::from_fn(|_| Default::default()) })
            .collect();
        for (c, plane) in self.data.chunks_exact_mut(g.plane()).enumerate().take(MAX_CHANNELS) {
            // Without the row of zeros above.
            let mut rest = &mut plane[g.stride..];
            for band in &mut bands {
                let (own, below) = rest.split_at_mut(band.groups.len() * GROUP * g.stride);
                band.channels[c] = own;
                rest = below;
            }
        }
        bands
    }
}
