//! What a correction is judged by: how far the denoised picture of one half is from what the other half says.
//!
//! With z^a of half a, that is r = y^b - z^a in every pixel, and where the renderer gave differences of y, G^b - ∇z^a too,
//! with their weight: both are unbiased and independent of half a.

use crate::blend_weight::LARGEST_RESIDUAL;
use crate::objective::own_weight;
use crate::prepare::Prepared;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;

/// One residual: of a colour or of a difference.
pub(crate) struct Residual<const N: usize> {
    /// Column of its pixel.
    pub x: usize,
    /// Weight of its square.
    pub weight: f32,
    /// By channel.
    pub whole: [f32; 3],
    /// The same, limited.
    pub r: [f32; 3],
    /// What each correction does to it, by channel.
    pub d: [[f32; 3]; N],
}

/// Residuals of both halves of a frame.
pub(crate) struct Residuals<'a> {
    prepared: &'a Prepared,
    weights: [Image; 2],
}

impl<'a> Residuals<'a> {
    pub fn new(prepared: &'a Prepared) -> Self {
        Self { prepared, weights: [0, 1].map(|h| own_weight(prepared, h)) }
    }

    /// Every residual of row `y`, with N corrections of both halves, `[3, H, W]` each.
    pub fn of_row<const N: usize>(&self, y: usize, corrected: [&[Image; 2]; N], mut tell: impl FnMut(Residual<N>)) {
        let prepared = self.prepared;
        for h in 0..2 {
            let weight = self.weights[h].row(0, y);
            let z = [0, 1, 2].map(|k| prepared.halves[h].row(DENOISED + k, y));
            let target = [0, 1, 2].map(|k| prepared.target_row(h, k, y));
            let corrected = corrected.map(|halves| [0, 1, 2].map(|k| halves[h].row(k, y)));
            for x in 0..prepared.width() {
                let less_z = |of: [&[f32]; 3]| [0, 1, 2].map(|k| of[k][x] - z[k][x]);
                let (whole, d) = (less_z(target), corrected.map(less_z));
                tell(Residual { x, weight: weight[x], whole, r: limited(whole, weight[x]), d });
            }
        }
        self.differences_of_row(y, corrected, tell);
    }

    fn differences_of_row<const N: usize>(
        &self,
        y: usize,
        corrected: [&[Image; 2]; N],
        mut tell: impl FnMut(Residual<N>),
    ) {
        let prepared = self.prepared;
        let Some(given) = &prepared.differences else { return };
        for (axis, h) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
            let (own, of_colour) = (given.weight.row(axis, y), self.weights[h].row(0, y));
            for x in (0..prepared.width()).filter(|&x| own[x] != 0.0) {
                let weight = own[x] * of_colour[x];
                // A difference that weighs has a neighbour.
                let (below, right) = (y + axis, x + 1 - axis);
                let z = |k: usize, y: usize, x: usize| prepared.halves[h].at(DENOISED + k, y, x);
                let whole =
                    [0, 1, 2].map(|k| given.halves[1 - h].at(3 * axis + k, y, x) - (z(k, below, right) - z(k, y, x)));
                let less_z = |image: &Image, k: usize, y: usize, x: usize| image.at(k, y, x) - z(k, y, x);
                let d = corrected
                    .map(|halves| [0, 1, 2].map(|k| less_z(&halves[h], k, below, right) - less_z(&halves[h], k, y, x)));
                tell(Residual { x, weight, whole, r: limited(whole, weight), d });
            }
        }
    }
}

/// A residual as it counts.
pub(crate) fn limited(r: [f32; 3], weight: f32) -> [f32; 3] {
    let limit = LARGEST_RESIDUAL / (weight * dot(r, r)).sqrt().max(LARGEST_RESIDUAL);
    r.map(|r| limit * r)
}

pub(crate) fn dot(p: [f32; 3], q: [f32; 3]) -> f32 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}
