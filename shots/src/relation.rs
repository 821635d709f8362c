//! Neighbours that are left out: the same picture again, another shot, noise shared with the other half.

use crate::field::Field;
use rayon::prelude::*;
use sspc_image::Image;

/// Side of the blocks over which noise is correlated, pixels: as for the halves of one frame.
const BLOCK: usize = 16;
/// Blocks that are looked at, about.
const BLOCKS: usize = 600;
/// Fewest blocks that a statement needs.
const FEWEST_BLOCKS: usize = 40;
/// Pixels of a picture that are compared, about.
const LOOKED_AT: usize = 40_000;
/// A neighbour whose z is correlated less than this with the frame's is of another shot: independent pictures gave up to
/// 0.4, neighbours of a shot 0.9 and more.
pub const LEAST_LIKENESS: f64 = 0.6;
/// The same for the mean validity by features: that of pixels that show other things is about 0.1 to 0.5.
pub const LEAST_VALIDITY: f64 = 0.1;
/// Excess of the correlation of noise above which it is shared: the limit for a frame's own halves.
pub const MOST_SHARED_NOISE: f64 = 0.07;

/// Whether both hold the same values, bit for bit: a frame that was held or copied adds nothing.
pub fn are_same(a: &Image, b: &Image) -> bool {
    a.channels() == b.channels()
        && a.same_size(b)
        && a.data().par_iter().zip(b.data()).all(|(a, b)| a.to_bits() == b.to_bits())
}

/// Correlation, -1..1, of the logarithms of two pictures' brightness, the second read along a field at the nearest pixel; 1
/// where one of both is flat, which tells nothing.
///
/// # Panics
/// When sizes differ.
pub fn likeness(centre: &Image, neighbour: &Image, field: &Field) -> f64 {
    assert!(centre.same_size(neighbour) && centre.same_size(field), "pictures of one size");
    let (height, width) = (centre.height(), centre.width());
    let stride = ((height * width) as f64 / LOOKED_AT as f64).sqrt().ceil().max(1.0) as usize;
    let mean = {
        let bright = |i: usize| (0..3).map(|c| f64::from(centre.plane(c)[i].max(0.0))).sum::<f64>() / 3.0;
        let values = (0..centre.pixels()).step_by(stride).map(bright).filter(|value| value.is_finite());
        let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
        if sum > 0.0 { sum / count } else { 1.0 }
    };
    let shown = |image: &Image, i: usize| {
        let bright = (0..3).map(|c| f64::from(image.plane(c)[i].max(0.0))).sum::<f64>() / 3.0;
        (1.0 + 8.0 * bright / mean).ln()
    };
    let (mut n, mut sums, mut squares) = (0.0, [0.0; 2], [0.0; 3]);
    for y in (stride / 2..height).step_by(stride) {
        for x in (stride / 2..width).step_by(stride) {
            let Some(at) = nearest(field, y, x) else { continue };
            let (a, b) = (shown(centre, y * width + x), shown(neighbour, at));
            if a.is_finite() && b.is_finite() {
                n += 1.0;
                sums = [sums[0] + a, sums[1] + b];
                squares = [squares[0] + a * a, squares[1] + b * b, squares[2] + a * b];
            }
        }
    }
    if n == 0.0 {
        return 0.0;
    }
    let [a, b] = sums.map(|sum| sum / n);
    let [aa, bb, ab] = [squares[0] / n - a * a, squares[1] / n - b * b, squares[2] / n - a * b];
    // Rounding of flat pictures.
    const FLAT: f64 = 1e-6;
    if aa > FLAT && bb > FLAT { ab / (aa * bb).sqrt() } else { 1.0 }
}

/// The pixel of the neighbour nearest to where pixel (x, y) lies, `None` outside.
fn nearest(field: &Field, y: usize, x: usize) -> Option<usize> {
    let (height, width) = (field.height() as f32, field.width() as f32);
    let (column, row) = ((x as f32 + field.at(0, y, x)).round(), (y as f32 + field.at(1, y, x)).round());
    let inside = column >= 0.0 && row >= 0.0 && column < width && row < height;
    inside.then(|| row as usize * field.width() + column as usize)
}

/// Noisy and denoised picture of one half, `[3, H, W]` each.
#[derive(Clone, Copy)]
pub struct Noisy<'a> {
    /// y.
    pub radiance: &'a Image,
    /// z.
    pub denoised: &'a Image,
}

/// How much more the residuals y - z of a half of this frame and of a half of a neighbour are correlated than those of this
/// frame's two halves: the median over blocks of the larger of both differences, at the same pixel and along the field. The
/// halves' own correlation is that of texture which the denoiser blurs, and that is no noise. `None` when too few blocks have noise.
///
/// # Panics
/// When sizes differ.
pub fn shared_noise(own: Noisy, other_half: Noisy, neighbour: Noisy, field: &Field) -> Option<f64> {
    let like = |picture: &Noisy| picture.radiance.same_size(field) && picture.denoised.same_size(field);
    assert!([&own, &other_half, &neighbour].into_iter().all(like), "pictures of one size");
    let (rows, columns) = (field.height() / BLOCK, field.width() / BLOCK);
    let stride = ((rows * columns) as f64 / BLOCKS as f64).ceil().max(1.0) as usize;
    let blocks: Vec<usize> = (0..rows * columns).step_by(stride).collect();
    let width = field.width();
    let residual = |picture: &Noisy, c: usize, i: usize| {
        f64::from(picture.radiance.plane(c)[i]) - f64::from(picture.denoised.plane(c)[i])
    };
    let of_block = |&block: &usize| {
        let (top, left) = (block / columns * BLOCK, block % columns * BLOCK);
        let correlation = |other: &Noisy, place: &dyn Fn(usize, usize) -> Option<usize>| {
            let (mut aa, mut bb, mut ab) = (0.0, 0.0, 0.0);
            for (y, x) in (top..top + BLOCK).flat_map(|y| (left..left + BLOCK).map(move |x| (y, x))) {
                let Some(at) = place(y, x) else { continue };
                for c in 0..3 {
                    let (a, b) = (residual(&own, c, y * width + x), residual(other, c, at));
                    if a.is_finite() && b.is_finite() {
                        (aa, bb, ab) = (aa + a * a, bb + b * b, ab + a * b);
                    }
                }
            }
            (aa > 0.0 && bb > 0.0).then(|| ab / (aa * bb).sqrt())
        };
        let here = |y: usize, x: usize| Some(y * width + x);
        let along = |y: usize, x: usize| nearest(field, y, x);
        let texture = correlation(&other_half, &here)?;
        let (still, moved) = (correlation(&neighbour, &here)?, correlation(&neighbour, &along).unwrap_or(-1.0));
        Some(still.max(moved) - texture)
    };
    let mut excess: Vec<f64> = blocks.par_iter().filter_map(of_block).collect();
    excess.sort_unstable_by(f64::total_cmp);
    (excess.len() >= FEWEST_BLOCKS).then(|| excess[excess.len() / 2])
}
