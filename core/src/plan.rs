//! What of a picture is worth computing: plain data that trainer and inference obey.
//!
//! A pixel whose three radiance values are the same in both halves shows no noise: background, or an
//! emitter seen directly. Blocks made of such pixels (and of missing ones) are left as the denoiser
//! made them; neither network nor g_c runs there, training never visits them, and the number of
//! steps shrinks with the share of the picture that is left.

use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::RADIANCE;
use sspc_kernels::region::Region;
use std::ops::Range;

/// Rows of a block.
pub const BLOCK_ROWS: usize = 8;
/// Columns of a block, one vector of the widest instruction set.
pub const BLOCK_COLUMNS: usize = 16;

/// Which blocks of a picture are computed.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    height: usize,
    width: usize,
    /// Row-major over blocks.
    active: Vec<bool>,
    /// Share of the picture's pixels that lie in active blocks, 0..1.
    pub active_share: f64,
}

impl Plan {
    /// The plan of two feature tensors `[13, H, W]`; `valid` is zero at missing pixels.
    pub fn new(halves: &[Image; 2], valid: Option<&Image>) -> Self {
        let (height, width) = (halves[0].height(), halves[0].width());
        let noisy = |i: usize| {
            valid.is_none_or(|v| v.plane(0)[i] != 0.0)
                && (RADIANCE..RADIANCE + 3).any(|k| halves[0].plane(k)[i] != halves[1].plane(k)[i])
        };
        let (rows, columns) = (height.div_ceil(BLOCK_ROWS), width.div_ceil(BLOCK_COLUMNS));
        let mut plan = Self { height, width, active: vec![false; rows * columns], active_share: 0.0 };
        let is_active = |block: usize| {
            let region = plan.block(block);
            let mut inside = (region.top..region.top + region.height)
                .flat_map(|y| (region.left..region.left + region.width).map(move |x| y * width + x));
            inside.any(noisy)
        };
        plan.active = (0..rows * columns).into_par_iter().with_min_len(columns.max(1)).map(is_active).collect();
        let pixels: usize = plan.active_blocks().iter().map(Region::pixels).sum();
        plan.active_share = pixels as f64 / (height * width).max(1) as f64;
        plan
    }

    /// A plan that computes everything.
    pub fn everything(height: usize, width: usize) -> Self {
        let blocks = height.div_ceil(BLOCK_ROWS) * width.div_ceil(BLOCK_COLUMNS);
        Self { height, width, active: vec![true; blocks], active_share: 1.0 }
    }

    /// A plan that computes nothing.
    pub fn nothing(height: usize, width: usize) -> Self {
        let blocks = height.div_ceil(BLOCK_ROWS) * width.div_ceil(BLOCK_COLUMNS);
        Self { height, width, active: vec![false; blocks], active_share: 0.0 }
    }

    /// The same plan without the blocks that lie outside `rows`; the share stays that of the picture.
    pub fn within_rows(&self, rows: Range<usize>) -> Self {
        let mut plan = self.clone();
        for (block, active) in plan.active.iter_mut().enumerate() {
            let Region { top, height, .. } = self.block(block);
            *active &= top < rows.end && top + height > rows.start;
        }
        plan
    }

    /// The plan of some rows by themselves; the share stays that of the picture.
    ///
    /// # Panics
    /// When the rows leave the picture, or begin inside a block.
    pub fn of_rows(&self, rows: Range<usize>) -> Self {
        assert!(rows.end <= self.height && rows.start.is_multiple_of(BLOCK_ROWS), "rows {rows:?} begin inside a block");
        let blocks = rows.start / BLOCK_ROWS * self.columns()..rows.end.div_ceil(BLOCK_ROWS) * self.columns();
        Self { height: rows.len(), active: self.active[blocks].to_vec(), ..*self }
    }

    /// Whether nothing is computed.
    pub fn is_idle(&self) -> bool {
        !self.active.contains(&true)
    }

    /// Whether the pixel's block is computed.
    pub fn is_active(&self, y: usize, x: usize) -> bool {
        self.active[y / BLOCK_ROWS * self.columns() + x / BLOCK_COLUMNS]
    }

    fn columns(&self) -> usize {
        self.width.div_ceil(BLOCK_COLUMNS)
    }

    fn block(&self, block: usize) -> Region {
        let (top, left) = (block / self.columns() * BLOCK_ROWS, block % self.columns() * BLOCK_COLUMNS);
        Region { top, left, height: BLOCK_ROWS.min(self.height - top), width: BLOCK_COLUMNS.min(self.width - left) }
    }

    /// Active blocks, in row order.
    pub fn active_blocks(&self) -> Vec<Region> {
        (0..self.active.len()).filter(|&b| self.active[b]).map(|b| self.block(b)).collect()
    }

    /// Blocks that are not computed, in row order.
    pub fn idle_blocks(&self) -> Vec<Region> {
        (0..self.active.len()).filter(|&b| !self.active[b]).map(|b| self.block(b)).collect()
    }

    /// Runs of active blocks of one block row, as wide as they go: what g_c is computed on.
    pub fn runs(&self) -> Vec<Region> {
        self.runs_in(&Region::whole(self.height, self.width))
    }

    /// The same in the pixels of `region`, counted from its first.
    pub fn runs_in(&self, region: &Region) -> Vec<Region> {
        let mut runs: Vec<Region> = Vec::new();
        for block in self.blocks_at(region).filter(|&block| self.active[block]) {
            let block = self.block(block).inside(region);
            match runs.last_mut() {
                Some(run) if run.top == block.top && run.left + run.width == block.left => run.width += block.width,
                _ => runs.push(block),
            }
        }
        runs
    }

    /// Whether any block that touches the region is active.
    pub fn touches(&self, region: &Region) -> bool {
        self.blocks_at(region).any(|block| self.active[block])
    }

    /// Blocks that touch the region, in row order.
    fn blocks_at(&self, region: &Region) -> impl Iterator<Item = usize> {
        let rows = region.top / BLOCK_ROWS..(region.top + region.height).div_ceil(BLOCK_ROWS);
        let columns = region.left / BLOCK_COLUMNS..(region.left + region.width).div_ceil(BLOCK_COLUMNS);
        let of_row = self.columns();
        rows.flat_map(move |row| columns.clone().map(move |column| row * of_row + column))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sspc_kernels::features::FEATURE_CHANNELS;

    #[test]
    fn runs_cover_every_noisy_pixel_and_no_still_block() {
        for (height, width) in [(1, 1), (9, 33), (40, 100)] {
            let quiet = Image::filled(FEATURE_CHANNELS, height, width, 0.5);
            let mut noisy = quiet.clone();
            let spots = [(0, 0), (height - 1, width - 1), (height / 2, width / 3)];
            spots.iter().for_each(|&(y, x)| noisy.set(1, y, x, 0.6));
            let plan = Plan::new(&[quiet, noisy], None);
            let runs = plan.runs();
            let inside = |r: &Region, y: usize, x: usize| {
                (r.top..r.top + r.height).contains(&y) && (r.left..r.left + r.width).contains(&x)
            };
            assert!(spots.iter().all(|&(y, x)| runs.iter().filter(|r| inside(r, y, x)).count() == 1));
            let pixels: usize = runs.iter().map(Region::pixels).sum();
            assert_eq!(pixels as f64 / (height * width) as f64, plan.active_share);
            assert!(pixels <= spots.len() * BLOCK_ROWS * BLOCK_COLUMNS);
            let runs_of = |rows: Range<usize>| {
                let runs = plan.of_rows(rows.clone()).runs();
                runs.into_iter().map(move |run| Region { top: rows.start + run.top, ..run }).collect::<Vec<_>>()
            };
            let cut = BLOCK_ROWS.min(height / BLOCK_ROWS * BLOCK_ROWS);
            assert_eq!([runs_of(0..cut), runs_of(cut..height)].concat(), runs, "the plan in two parts");
        }
    }

    /// A plan with holes, cut anywhere.
    #[test]
    fn runs_of_a_region_are_the_plans_there() {
        let (height, width) = (45, 70);
        let mut plan = Plan::everything(height, width);
        plan.active.iter_mut().enumerate().for_each(|(at, active)| *active = at * at % 5 < 3);
        for region in [
            Region::whole(height, width),
            Region { top: 3, left: 5, height: 30, width: 40 },
            Region { top: 8, left: 16, height: 8, width: 16 },
            Region { top: 44, left: 69, height: 1, width: 1 },
        ] {
            let runs = plan.runs_in(&region);
            for (y, x) in (0..region.height).flat_map(|y| (0..region.width).map(move |x| (y, x))) {
                let holds =
                    |r: &&Region| (r.top..r.top + r.height).contains(&y) && (r.left..r.left + r.width).contains(&x);
                let expected = usize::from(plan.is_active(region.top + y, region.left + x));
                assert_eq!(runs.iter().filter(holds).count(), expected, "({y}, {x}) of {region:?}");
            }
            assert!(runs.iter().all(|run| run.top + run.height <= region.height && run.pixels() > 0), "{runs:?}");
            assert_eq!(plan.touches(&region), !runs.is_empty());
        }
    }

    #[test]
    fn equal_halves_leave_nothing_to_do() {
        let still = Image::filled(FEATURE_CHANNELS, 20, 50, 1.0);
        let plan = Plan::new(&[still.clone(), still], None);
        assert!(plan.runs().is_empty() && plan.active_share == 0.0);
        assert!(!plan.touches(&Region { top: 0, left: 0, height: 20, width: 50 }));
    }

    #[test]
    fn missing_pixels_are_no_noise() {
        let still = Image::filled(FEATURE_CHANNELS, 20, 50, 0.5);
        let mut spotted = still.clone();
        spotted.set(2, 3, 40, 0.6);
        let mut valid = Image::filled(1, 20, 50, 1.0);
        let halves = [still, spotted];
        assert_eq!(Plan::new(&halves, Some(&valid)).runs(), [Region { top: 0, left: 32, height: 8, width: 16 }]);
        valid.set(0, 3, 40, 0.0);
        assert!(Plan::new(&halves, Some(&valid)).runs().is_empty());
    }

    #[test]
    fn the_smallest_difference_is_noise() {
        // Halves that are equal but for one pixel by one bit, and one of them zero.
        for value in [0.5, 0.0] {
            let still = Image::filled(FEATURE_CHANNELS, 9, 9, value);
            let mut other = still.clone();
            other.set(0, 8, 8, f32::from_bits(value.to_bits() + 1));
            let plan = Plan::new(&[still, other], None);
            assert_eq!(plan.runs(), [Region { top: 8, left: 0, height: 1, width: 9 }]);
        }
    }
}
