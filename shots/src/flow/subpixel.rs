//! Displacements of blocks to parts of a pixel: Gauss-Newton steps on the squared differences of a patch.

use super::blocks::{Blocks, PATCH, patch_of};
use super::pyramid::{BORDER, Level};
use rayon::prelude::*;

/// Steps at most.
const STEPS: usize = 4;
/// Steps shorter than this, pixels, are the last.
const SHORT: f32 = 0.02;
/// Farthest from the whole-pixel displacement, pixels: beyond, the steps have lost their way.
const FARTHEST: f32 = 1.0;
/// Added to the diagonal of the normal equations, for each value of a patch: noise has no say where there is no texture.
const DAMPING: f32 = 1e-3;

/// The blocks' displacements, each near its whole-pixel one.
pub fn refined(own: &Level, other: &Level, blocks: &Blocks) -> Blocks {
    let of_block = |at: usize| {
        let (row, column) = (at / blocks.columns, at % blocks.columns);
        of_patch(own, other, patch_of(row, column), blocks.moved[at])
    };
    let moved = (0..blocks.moved.len()).into_par_iter().with_min_len(64).map(of_block).collect();
    Blocks { moved, ..*blocks }
}

fn of_patch(own: &Level, other: &Level, (y, x): (isize, isize), start: (f32, f32)) -> (f32, f32) {
    let normal = normal_matrix(own, (y, x));
    let mut moved = start;
    let mut best = (start, f32::INFINITY);
    for _ in 0..=STEPS {
        let Some((cost, [right, down])) = residuals(own, other, (y, x), moved) else { break };
        if cost >= best.1 {
            break;
        }
        best = (moved, cost);
        let [xx, yy, xy] = normal;
        let determinant = xx * yy - xy * xy;
        let step = ((yy * right - xy * down) / determinant, (xx * down - xy * right) / determinant);
        moved = (moved.0 - step.0, moved.1 - step.1);
        let strayed = (moved.0 - start.0).abs().max((moved.1 - start.1).abs()) > FARTHEST;
        // Also where the steps are not finite.
        let goes_on = step.0.abs().max(step.1.abs()) >= SHORT && !strayed;
        if !goes_on {
            if !strayed && moved.0.is_finite() && moved.1.is_finite() {
                best.0 = moved;
            }
            break;
        }
    }
    best.0
}

/// Σ of ∂x², ∂y² and ∂x ∂y over a patch, damped.
fn normal_matrix(own: &Level, (y, x): (isize, isize)) -> [f32; 3] {
    let mut sums = [[0.0f32; PATCH]; 3];
    for c in 0..own.channels() {
        for row in 0..PATCH as isize {
            let middle = &own.from(c, y + row, x - 1)[..PATCH + 2];
            let (above, below) = (&own.from(c, y + row - 1, x)[..PATCH], &own.from(c, y + row + 1, x)[..PATCH]);
            for k in 0..PATCH {
                let (dx, dy) = (0.5 * (middle[k + 2] - middle[k]), 0.5 * (below[k] - above[k]));
                sums[0][k] += dx * dx;
                sums[1][k] += dy * dy;
                sums[2][k] += dx * dy;
            }
        }
    }
    let [xx, yy, xy] = sums.map(|lanes| lanes.iter().sum::<f32>());
    let damping = DAMPING * (PATCH * PATCH * own.channels()) as f32;
    [xx + damping, yy + damping, xy]
}

/// Σ of squared differences, and of differences times the patch's slopes; `None` where the patch would leave the border.
fn residuals(own: &Level, other: &Level, (y, x): (isize, isize), (dx, dy): (f32, f32)) -> Option<(f32, [f32; 2])> {
    let (left, top) = (dx.floor(), dy.floor());
    let (fx, fy) = (dx - left, dy - top);
    let (column, row) = (x + left as isize, y + top as isize);
    let border = BORDER as isize;
    let fits = |at: isize, size: usize| at >= -border && at + (PATCH as isize) < size as isize + border;
    if !(fits(column, own.width()) && fits(row, own.height())) {
        return None;
    }
    let mut squares = [0.0f32; PATCH];
    let mut slopes = [[0.0f32; PATCH]; 2];
    for c in 0..own.channels() {
        for k in 0..PATCH as isize {
            let (upper, lower) =
                (&other.from(c, row + k, column)[..PATCH + 1], &other.from(c, row + k + 1, column)[..PATCH + 1]);
            let middle = &own.from(c, y + k, x - 1)[..PATCH + 2];
            let (above, below) = (&own.from(c, y + k - 1, x)[..PATCH], &own.from(c, y + k + 1, x)[..PATCH]);
            for i in 0..PATCH {
                let top = upper[i] + fx * (upper[i + 1] - upper[i]);
                let bottom = lower[i] + fx * (lower[i + 1] - lower[i]);
                let apart = top + fy * (bottom - top) - middle[i + 1];
                squares[i] += apart * apart;
                slopes[0][i] += apart * 0.5 * (middle[i + 2] - middle[i]);
                slopes[1][i] += apart * 0.5 * (below[i] - above[i]);
            }
        }
    }
    Some((squares.iter().sum(), slopes.map(|lanes| lanes.iter().sum())))
}
