//! What a correction is judged by: how far the denoised picture of one half is from what the other half says.
//!
//! With z^a of half a, that is r = y^b - z^a in every pixel, and where the renderer gave differences of y, G^b - ∇z^a too,
//! with their weight: both are unbiased and independent of half a.

use crate::blend_weight::LARGEST_RESIDUAL;
use crate::lanes::{LANES, lanes, lanes_of_colour, less, squared};
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
    #[inline(always)]
    pub fn of_row<const N: usize>(&self, y: usize, corrected: [&[Image; 2]; N], mut tell: impl FnMut(Residual<N>)) {
        let prepared = self.prepared;
        for h in 0..2 {
            let weights = self.weights[h].row(0, y);
            let z = [0, 1, 2].map(|k| prepared.halves[h].row(DENOISED + k, y));
            let target = [0, 1, 2].map(|k| prepared.target_row(h, k, y));
            let corrected = corrected.map(|halves| [0, 1, 2].map(|k| halves[h].row(k, y)));
            for first in (0..prepared.width()).step_by(LANES) {
                let (weight, z) = (lanes(weights, first), lanes_of_colour(&z, first));
                let mut whole = lanes_of_colour(&target, first);
                let mut d = [[[0.0; LANES]; 3]; N];
                for k in 0..3 {
                    whole[k] = less(&whole[k], &z[k]);
                    for (d, corrected) in d.iter_mut().zip(&corrected) {
                        d[k] = less(&lanes(corrected[k], first), &z[k]);
                    }
                }
                let limit = limits(&whole, &weight);
                for i in 0..LANES.min(prepared.width() - first) {
                    let whole = [whole[0][i], whole[1][i], whole[2][i]];
                    let r = [limit[i] * whole[0], limit[i] * whole[1], limit[i] * whole[2]];
                    let mut of_pixel = [[0.0; 3]; N];
                    for (pixel, d) in of_pixel.iter_mut().zip(&d) {
                        *pixel = [d[0][i], d[1][i], d[2][i]];
                    }
                    tell(Residual { x: first + i, weight: weight[i], whole, r, d: of_pixel });
                }
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
#[inline(always)]
pub(crate) fn limited(r: [f32; 3], weight: f32) -> [f32; 3] {
    let limit = limit(dot(r, r), weight);
    [limit * r[0], limit * r[1], limit * r[2]]
}

/// What residuals count, 0..1.
#[inline(always)]
fn limits(r: &[[f32; LANES]; 3], weight: &[f32; LANES]) -> [f32; LANES] {
    let mut limits = squared(r);
    for i in 0..LANES {
        limits[i] = limit(limits[i], weight[i]);
    }
    limits
}

#[inline(always)]
fn limit(squared: f32, weight: f32) -> f32 {
    LARGEST_RESIDUAL / (weight * squared).sqrt().max(LARGEST_RESIDUAL)
}

#[inline(always)]
pub(crate) fn dot(p: [f32; 3], q: [f32; 3]) -> f32 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}
