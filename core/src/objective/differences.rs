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
    /// weighs `strength` times that, times the variance of y over that of the difference.
    pub fn new(prepared: &Prepared, given: &Differences, h: usize, colour: &Image, strength: f32) -> Self {
        let (height, width) = (prepared.height(), prepared.width());
        let weight = Image::from_rows(2, height, width, |axis, y, row| {
            for (x, weight) in row.iter_mut().enumerate() {
                let known = given.known.at(axis, y, x);
                *weight = known * colour.at(0, y, x) * strength * quietness(prepared, given, axis, y, x).min(HEAVIEST);
            }
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

/// The variance of y over that of a difference, around a pixel and without it. Outliers make it smaller in both: the mean
/// of |y^a - y^b| is squared, that of differences is one of squares.
fn quietness(prepared: &Prepared, given: &Differences, axis: usize, y: usize, x: usize) -> f32 {
    let (height, width) = (prepared.height(), prepared.width());
    let (mut of_y, mut of_differences, mut count) = (0.0f32, 0.0f32, 0.0f32);
    for y_at in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(height) {
        for x_at in x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(width) {
            if (y_at, x_at) == (y, x) || given.known.at(axis, y_at, x_at) == 0.0 {
                continue;
            }
            let apart = |images: [&Image; 2], c: usize| images[0].at(c, y_at, x_at) - images[1].at(c, y_at, x_at);
            let [a, b] = [&*prepared.halves[0], &*prepared.halves[1]];
            of_y += (0..3).map(|k| apart([a, b], RADIANCE + k).abs()).sum::<f32>() / 3.0;
            let [a, b] = [&given.halves[0], &given.halves[1]];
            of_differences += (0..3).map(|k| apart([a, b], 3 * axis + k).powi(2)).sum::<f32>() / 3.0;
            count += 1.0;
        }
    }
    let of_y = of_y / count.max(1.0);
    // Equal differences of noisy colours are exact; without noise nothing is weighed.
    if of_y == 0.0 { 0.0 } else { of_y * of_y / (of_differences / count.max(1.0)).max(1e-30) }
}
