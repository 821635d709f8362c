//! What differences of a half's correction are compared with, and how heavily.
//!
//! As for colours, E\[w ‖∇μ̂^a - G^b‖²\] is E\[w ‖∇μ̂^a - ∇μ‖²\] but for a constant, where G^b estimates ∇μ without bias and is
//! independent of half a and of the weight w. Noise of one pixel's G is independent of that of other pixels, so the
//! weight of a pixel is made of its neighbours and not of itself.

use crate::differences::Differences;
use crate::prepare::Prepared;
use sspc_image::Image;
use sspc_kernels::features::RADIANCE;

/// Differences of the other half, and the weights of their squared errors.
#[derive(Clone, Debug)]
pub struct DifferenceTarget {
    /// dx, then dy, of the other half, `[6, H, W]`.
    pub target: Image,
    /// Weights of both, `[2, H, W]`; 0 where a difference is not known.
    pub weight: Image,
}

/// Neighbours on each side that the noise is measured of.
const RADIUS: usize = 2;
/// Most that a difference weighs beside a colour.
const HEAVIEST: f32 = 10.0;

impl DifferenceTarget {
    /// What differences of half `h` are compared with. `colour` is the weight of its colours, `[1, H, W]`; a difference
    /// weighs that times its own ([`difference_weight`]).
    pub fn new(given: &Differences, h: usize, colour: &Image) -> Self {
        let weight = Image::from_rows(2, colour.height(), colour.width(), |axis, y, row| {
            let of_both = given.weight.row(axis, y).iter().zip(colour.row(0, y));
            row.iter_mut().zip(of_both).for_each(|(weight, (own, colour))| *weight = own * colour);
        });
        Self { target: given.halves[1 - h].clone(), weight }
    }

    /// The same without the differences that touch a pixel (y, x) of which `is_left_out` is true.
    pub fn leave_out(&mut self, is_left_out: impl Fn(usize, usize) -> bool + Sync) {
        self.weight.for_each_row(|axis, y, row| {
            for (x, weight) in row.iter_mut().enumerate() {
                if is_left_out(y, x) || is_left_out(y + axis, x + 1 - axis) {
                    *weight = 0.0;
                }
            }
        });
    }
}

/// What differences of both halves `[6, H, W]` weigh beside a colour, `[2, H, W]`: `strength` times the variance of y over that
/// of a difference, around a pixel and without it, at most ten times; 0 where they are not `known` `[2, H, W]`.
///
/// Outliers make it smaller in both: the mean of |y^a - y^b| is squared, that of differences is one of squares.
pub fn difference_weight(prepared: &Prepared, halves: &[Image; 2], known: &Image, strength: f32) -> Image {
    let (height, width) = (known.height(), known.width());
    let [a, b] = [0, 1].map(|h| &*prepared.halves[h]);
    let of_y = Image::from_rows(1, height, width, |_, y, row| {
        for (x, apart) in row.iter_mut().enumerate() {
            *apart = (RADIANCE..RADIANCE + 3).map(|c| (a.at(c, y, x) - b.at(c, y, x)).abs()).sum::<f32>() / 3.0;
        }
    });
    let of_differences = Image::from_rows(2, height, width, |axis, y, row| {
        for (x, apart) in row.iter_mut().enumerate() {
            let apart_of = |c: usize| (halves[0].at(c, y, x) - halves[1].at(c, y, x)).powi(2);
            *apart = (3 * axis..3 * axis + 3).map(apart_of).sum::<f32>() / 3.0;
        }
    });
    Image::from_rows(2, height, width, |axis, y, row| {
        for (x, weight) in row.iter_mut().enumerate().filter(|(x, _)| known.at(axis, y, *x) != 0.0) {
            let (mut noise, mut of_difference, mut count) = (0.0f32, 0.0f32, 0.0f32);
            for y_at in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(height) {
                for x_at in x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(width) {
                    if (y_at, x_at) != (y, x) && known.at(axis, y_at, x_at) != 0.0 {
                        noise += of_y.at(0, y_at, x_at);
                        of_difference += of_differences.at(axis, y_at, x_at);
                        count += 1.0;
                    }
                }
            }
            let (noise, of_difference) = (noise / count.max(1.0), of_difference / count.max(1.0));
            // Equal differences of noisy colours are exact; without noise nothing is weighed.
            let quiet = if noise == 0.0 { 0.0 } else { noise * noise / of_difference.max(1e-30) };
            *weight = strength * quiet.min(HEAVIEST);
        }
    })
}
