//! Displacements of blocks by whole pixels: the least sum of absolute differences of a patch around each block.

use super::pyramid::{BORDER, Level};
use rayon::prelude::*;

/// Side of a block, pixels of its level.
pub const BLOCK: usize = 4;
/// Side of the patch that is compared, with the block in its middle.
pub const PATCH: usize = 8;
/// Pixels of the patch before the block.
pub const BEFORE: isize = ((PATCH - BLOCK) / 2) as isize;
/// How far the coarsest level is searched, pixels.
const COARSEST_REACH: isize = 6;
/// What a pixel of distance from the coarser level's displacement costs, for each value of a patch: less than noise, more
/// than nothing where a surface has no texture.
const SMOOTHNESS: f32 = 2e-3;

/// Displacements of a level's blocks, row by row, pixels of the level.
pub struct Blocks {
    /// Rows of blocks.
    pub rows: usize,
    /// Columns of blocks.
    pub columns: usize,
    /// (to the right, down) of each block.
    pub moved: Vec<(f32, f32)>,
}

impl Blocks {
    /// The displacement of the block at (row, column), or of the nearest one.
    pub fn at(&self, row: isize, column: isize) -> (f32, f32) {
        let row = row.clamp(0, self.rows as isize - 1) as usize;
        let column = column.clamp(0, self.columns as isize - 1) as usize;
        self.moved[row * self.columns + column]
    }

    /// The median of each component over a block and its eight neighbours.
    pub fn smoothed(&self) -> Blocks {
        let median = |at: usize| {
            let (row, column) = ((at / self.columns) as isize, (at % self.columns) as isize);
            let mut right = [0.0f32; 9];
            let mut down = [0.0f32; 9];
            for k in 0..9 {
                (right[k], down[k]) = self.at(row + k as isize / 3 - 1, column + k as isize % 3 - 1);
            }
            right.sort_unstable_by(f32::total_cmp);
            down.sort_unstable_by(f32::total_cmp);
            (right[4], down[4])
        };
        let moved = (0..self.moved.len()).into_par_iter().with_min_len(256).map(median).collect();
        Blocks { moved, ..*self }
    }
}

/// First row and column of a block's patch.
pub fn patch_of(row: usize, column: usize) -> (isize, isize) {
    ((row * BLOCK) as isize - BEFORE, (column * BLOCK) as isize - BEFORE)
}

/// A displacement of a patch that stays within the border.
pub fn within(level: &Level, (y, x): (isize, isize), (dx, dy): (isize, isize)) -> (isize, isize) {
    let border = BORDER as isize - 1;
    let last = |size: usize| size as isize + border - PATCH as isize;
    let right = (x + dx).clamp(-border, last(level.width())) - x;
    let down = (y + dy).clamp(-border, last(level.height())) - y;
    (right, down)
}

/// The blocks' displacements, from those of the next coarser level.
pub fn matched(own: &Level, other: &Level, coarser: Option<&Blocks>) -> Blocks {
    let (rows, columns) = (own.height().div_ceil(BLOCK), own.width().div_ceil(BLOCK));
    let of_block = |at: usize| {
        let (row, column) = (at / columns, at % columns);
        let search = Search { own, other, patch: patch_of(row, column) };
        let (dx, dy) = match coarser {
            None => search.everywhere(),
            Some(coarser) => search.around(&starts(coarser, row, column)),
        };
        (dx as f32, dy as f32)
    };
    let moved = (0..rows * columns).into_par_iter().with_min_len(64).map(of_block).collect();
    Blocks { rows, columns, moved }
}

/// Where the search of a block begins: at the displacements of the coarser block that it is a part of and of the nearest
/// ones around it.
fn starts(coarser: &Blocks, row: usize, column: usize) -> [(isize, isize); 5] {
    let (r, c) = ((row / 2) as isize, (column / 2) as isize);
    let (down, right) = (2 * (row % 2) as isize - 1, 2 * (column % 2) as isize - 1);
    let at = |r: isize, c: isize| {
        let (dx, dy) = coarser.at(r, c);
        (2 * dx as isize, 2 * dy as isize)
    };
    [at(r, c), at(r + down, c), at(r, c + right), at(r - down, c), at(r, c - right)]
}

struct Search<'a> {
    own: &'a Level,
    other: &'a Level,
    patch: (isize, isize),
}

impl Search<'_> {
    /// Sum of absolute differences of the patch and the other picture's at a displacement.
    fn cost(&self, (dx, dy): (isize, isize)) -> f32 {
        let (y, x) = self.patch;
        let mut sums = [0.0f32; PATCH];
        for c in 0..self.own.channels() {
            for row in 0..PATCH as isize {
                let own = &self.own.from(c, y + row, x)[..PATCH];
                let other = &self.other.from(c, y + row + dy, x + dx)[..PATCH];
                (0..PATCH).for_each(|k| sums[k] += (own[k] - other[k]).abs());
            }
        }
        ((sums[0] + sums[1]) + (sums[2] + sums[3])) + ((sums[4] + sums[5]) + (sums[6] + sums[7]))
    }

    /// The cost with what the distance from a displacement adds.
    fn smooth_cost(&self, moved: (isize, isize), from: (isize, isize)) -> f32 {
        let distance = ((moved.0 - from.0).abs() + (moved.1 - from.1).abs()) as f32;
        self.cost(moved) + SMOOTHNESS * (PATCH * PATCH * self.own.channels()) as f32 * distance
    }

    fn everywhere(&self) -> (isize, isize) {
        let reach = -COARSEST_REACH..=COARSEST_REACH;
        let all = reach.clone().flat_map(|dy| reach.clone().map(move |dx| (dx, dy)));
        self.best(all.map(|moved| within(self.own, self.patch, moved)), (0, 0)).0
    }

    fn around(&self, starts: &[(isize, isize)]) -> (isize, isize) {
        let first = within(self.own, self.patch, starts[0]);
        let mut distinct: Vec<(isize, isize)> = Vec::with_capacity(starts.len() + 1);
        for start in starts.iter().copied().chain([(0, 0)]) {
            let start = within(self.own, self.patch, start);
            if !distinct.contains(&start) {
                distinct.push(start);
            }
        }
        let (start, _) = self.best(distinct.into_iter(), first);
        let near = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (start.0 + dx, start.1 + dy)));
        self.best(near.map(|moved| within(self.own, self.patch, moved)), first).0
    }

    fn best(&self, all: impl Iterator<Item = (isize, isize)>, from: (isize, isize)) -> ((isize, isize), f32) {
        let mut best = (from, f32::INFINITY);
        for moved in all {
            let cost = self.smooth_cost(moved, from);
            if cost < best.1 {
                best = (moved, cost);
            }
        }
        best
    }
}
