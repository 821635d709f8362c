//! From displacements of blocks to those of pixels.

use super::blocks::{BLOCK, Blocks};
use super::pyramid::Level;
use crate::field::Field;
use crate::warp::for_rows;
use sspc_image::Image;

/// Squared difference, for each plane, below which a displacement fits as well as any: that of noise.
const NOISE: f32 = 0.01;

/// Blocks' displacements that differ by less, pixels, are of one thing: the pixels between them move evenly.
const OF_ONE_THING: f32 = 0.5;

/// The displacement of every pixel, from those of the blocks of a coarser level: the mean of the four blocks around it, by
/// nearness; where these move differently, also by how well each fits the pixel.
pub fn field(own: &Level, other: &Level, blocks: &Blocks, level: usize) -> Field {
    let (height, width) = (own.height(), own.width());
    let mut field = Image::zeros(2, height, width);
    let noise = NOISE * own.channels() as f32;
    let scale = (1 << level) as f32;
    let side = BLOCK as f32 * scale;
    // The block whose middle is before a pixel, and the share of the next one.
    let place = |at: usize| {
        let at = (at as f32 + 0.5) / side - 0.5;
        (at.floor() as isize, at - at.floor())
    };
    for_rows(&mut [&mut field], |y, rows| {
        let [right, down] = rows else { return };
        let (row, lower) = place(y);
        let mut around = None;
        for x in 0..width {
            let (column, later) = place(x);
            let four = match around {
                Some((at, four)) if at == column => four,
                _ => corners(blocks, row, column, scale),
            };
            around = Some((column, four));
            let near = [(1.0 - lower) * (1.0 - later), (1.0 - lower) * later, lower * (1.0 - later), lower * later];
            let (moved, alike) = four;
            let weights = match alike {
                true => near,
                false => [0, 1, 2, 3].map(|k| (near[k] + 0.05) / (noise + misfit(own, other, (y, x), moved[k]))),
            };
            let sum = |of: &dyn Fn(usize) -> f32| (of(0) + of(1)) + (of(2) + of(3));
            let all = sum(&|k| weights[k]);
            right[x] = sum(&|k| weights[k] * moved[k].0) / all;
            down[x] = sum(&|k| weights[k] * moved[k].1) / all;
        }
    });
    field
}

/// Displacements of four blocks around a place, pixels of the picture, and whether they are of one thing.
fn corners(blocks: &Blocks, row: isize, column: isize, scale: f32) -> ([(f32, f32); 4], bool) {
    let moved = [(0, 0), (0, 1), (1, 0), (1, 1)].map(|(r, c)| {
        let (dx, dy) = blocks.at(row + r, column + c);
        (scale * dx, scale * dy)
    });
    let apart = |(dx, dy): (f32, f32)| (dx - moved[0].0).abs().max((dy - moved[0].1).abs());
    (moved, moved.into_iter().all(|other| apart(other) <= OF_ONE_THING))
}

/// Squared difference of a pixel and where it would lie, to the nearest pixel; large where that is outside.
fn misfit(own: &Level, other: &Level, (y, x): (usize, usize), (dx, dy): (f32, f32)) -> f32 {
    let (column, row) = (x as f32 + dx, y as f32 + dy);
    let inside = column >= 0.0 && row >= 0.0 && column <= (own.width() - 1) as f32 && row <= (own.height() - 1) as f32;
    if !inside {
        return own.channels() as f32;
    }
    let (left, top) = (column as isize, row as isize);
    let (fx, fy) = (column - left as f32, row - top as f32);
    let mut sum = 0.0;
    for c in 0..own.channels() {
        let (upper, lower) = (&other.from(c, top, left)[..2], &other.from(c, top + 1, left)[..2]);
        let above = upper[0] + fx * (upper[1] - upper[0]);
        let below = lower[0] + fx * (lower[1] - lower[0]);
        let apart = above + fy * (below - above) - own.from(c, y as isize, x as isize)[0];
        sum += apart * apart;
    }
    sum
}
