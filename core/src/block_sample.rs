//! Some of a picture's blocks, whole: what is looked at closer than by sums over every pixel.

use crate::estimate::BLOCK;
use sspc_image::{Frame, Image, Role};

/// Blocks that are kept, about, at most: 6 MB, and a standard error of a correlation of 0.008.
const MOST_BLOCKS: usize = 320;
/// Pixels of a block.
pub(crate) const AREA: usize = BLOCK * BLOCK;
/// Planes of r of one half.
pub(crate) const RESIDUALS: usize = 3;
/// Planes of albedo and normal of one half.
pub(crate) const FEATURES: usize = 6;

/// Some of a picture's blocks, gathered from its bands from top to bottom.
pub(crate) struct BlockSample {
    /// Of 2³² blocks, this many are kept.
    density: u64,
    rows: usize,
    blocks: Vec<Block>,
}

/// Pixels of a block that lies inside the picture.
pub(crate) struct Block {
    /// Its place among all blocks, row by row.
    index: usize,
    left: usize,
    /// Rows so far.
    rows: usize,
    /// r = y - z of half a, of half b, then albedo and normal of half a, of half b.
    planes: Vec<f32>,
}

impl BlockSample {
    /// Of a picture of that many pixels.
    pub(crate) fn new(pixels: usize) -> Self {
        let density = ((MOST_BLOCKS as u64) << 32) / (pixels / AREA).max(1) as u64;
        Self { density, rows: 0, blocks: Vec::new() }
    }

    /// Looks at the next rows; `valid` `[1, H, W]` is 0 at missing pixels.
    pub(crate) fn look(&mut self, band: &Frame, valid: &Image) {
        for y in 0..band.height() {
            if self.rows.is_multiple_of(BLOCK) {
                self.start_blocks(band.width());
            }
            let unfinished = self.blocks.iter().rposition(|block| block.rows == BLOCK).map_or(0, |last| last + 1);
            self.blocks[unfinished..].iter_mut().for_each(|block| block.add(band, valid.row(0, y), y));
            self.rows += 1;
        }
    }

    /// Begins the blocks of the next row of blocks, spread evenly by the golden ratio.
    fn start_blocks(&mut self, width: usize) {
        const GOLDEN: u64 = 0x9E37_79B9_7F4A_7C15;
        self.blocks.retain(|block| block.rows == BLOCK);
        let first = self.rows / BLOCK * width.div_ceil(BLOCK);
        for column in 0..width / BLOCK {
            let index = first + column;
            if (index as u64).wrapping_mul(GOLDEN) >> 32 < self.density {
                self.blocks.push(Block {
                    index,
                    left: column * BLOCK,
                    rows: 0,
                    planes: vec![0.0; 2 * (RESIDUALS + FEATURES) * AREA],
                });
            }
        }
    }

    /// The blocks that are whole and chosen by their place among all blocks.
    pub(crate) fn blocks(&self, is_chosen: impl Fn(usize) -> bool) -> Vec<&Block> {
        self.blocks.iter().filter(|block| block.rows == BLOCK && is_chosen(block.index)).collect()
    }
}

impl Block {
    /// Planes of r of both halves, half a's first.
    pub(crate) fn residuals(&self) -> &[f32] {
        &self.planes[..2 * RESIDUALS * AREA]
    }

    /// Planes of albedo and normal of both halves, half a's first; 0 where a half has none.
    pub(crate) fn features(&self) -> &[f32] {
        &self.planes[2 * RESIDUALS * AREA..]
    }

    /// Adds row `y` of a band.
    fn add(&mut self, band: &Frame, valid: &[f32], y: usize) {
        let (row, pixels) = (self.rows * BLOCK, self.left..self.left + BLOCK);
        let halves = [&band.a, &band.b];
        for (h, half) in halves.into_iter().enumerate() {
            for c in 0..3 {
                let out = &mut self.planes[(RESIDUALS * h + c) * AREA + row..][..BLOCK];
                let (y_row, z_row) = (half.radiance.row(c, y), half.denoised.row(c, y));
                for (out, x) in out.iter_mut().zip(pixels.clone()) {
                    *out = if valid[x] != 0.0 { y_row[x] - z_row[x] } else { 0.0 };
                }
            }
            for (first, role) in [(0, Role::Albedo), (3, Role::Normal)] {
                let Some(feature) =
                    half.feature(role).filter(|_| halves.iter().all(|half| half.feature(role).is_some()))
                else {
                    continue;
                };
                for c in 0..feature.channels().min(3) {
                    let out = &mut self.planes[(2 * RESIDUALS + FEATURES * h + first + c) * AREA + row..][..BLOCK];
                    out.copy_from_slice(&feature.row(c, y)[pixels.clone()]);
                }
            }
        }
        self.rows += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::independence::tests::frame;

    #[test]
    fn of_a_large_picture_some_blocks_are_kept_all_over_it() {
        let band = Frame { denoised: None, ..frame(0.0, |_, _| 0.0) };
        let mut sample = BlockSample::new(40 * 192 * 256);
        let valid = Image::filled(1, 192, 256, 1.0);
        (0..40).for_each(|_| sample.look(&band, &valid));
        assert!(
            (MOST_BLOCKS * 9 / 10..=MOST_BLOCKS * 11 / 10).contains(&sample.blocks.len()),
            "{}",
            sample.blocks.len()
        );
        let columns: std::collections::BTreeSet<usize> = sample.blocks.iter().map(|block| block.left).collect();
        assert_eq!(columns.len(), 16);
    }
}
