//! What a pixel's squared error is divided by.

use super::RELATIVE_FLOOR;
use crate::prepare::Prepared;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;

/// 1 / (z̄² + floor) of one pixel's z.
#[inline(always)]
pub fn weight_of(z: [f32; 3], floor: f32) -> f32 {
    let mean = (z[0] + z[1] + z[2]) / 3.0;
    1.0 / (mean * mean + floor)
}

/// 1 / (z̄² + floor) of features `[13, H, W]`, 0 where a pixel is missing.
pub fn relative_weight(features: &Image, valid: Option<&Image>, floor: f32) -> Image {
    Image::from_rows(1, features.height(), features.width(), |_, y, row| {
        let [red, green, blue] = [0, 1, 2].map(|k| features.row(DENOISED + k, y));
        for (((weight, red), green), blue) in row.iter_mut().zip(red).zip(green).zip(blue) {
            *weight = weight_of([*red, *green, *blue], floor);
        }
        for (weight, valid) in row.iter_mut().zip(valid.map_or(&[][..], |valid| valid.row(0, y))) {
            *weight = if *valid == 0.0 { 0.0 } else { *weight };
        }
    })
}

/// 1 / (z̄² + 0.01) of a half's own z: the weight under which y of the other half is an unbiased judge.
///
/// The paper weighs by the z of the half compared with. Noise of y^b that the denoiser let through makes
/// z^b bright where y^b is bright, so such pixels count less than those whose noise is dark: under that
/// weight the least error lies below the truth, the more so the noisier the frame, and a correction
/// that only darkens seems to help. With w(z^a), E\[w (μ̂^a - y^b)²\] is E\[w (μ̂^a - μ)²\] but for a
/// constant: y^b is independent of everything of half a.
pub fn own_weight(prepared: &Prepared, half: usize) -> Image {
    relative_weight(&prepared.halves[half], prepared.valid.as_ref(), RELATIVE_FLOOR)
}

/// The three planes from `first` on.
pub fn triple(features: &Image, first: usize) -> Image {
    Image::from_rows(3, features.height(), features.width(), |k, y, row| {
        row.copy_from_slice(features.row(first + k, y));
    })
}
