//! What a pixel's squared error is divided by.

use super::RELATIVE_FLOOR;
use crate::features::DENOISED;
use crate::image::Image;
use crate::prepare::Prepared;

/// 1 / (z̄² + floor) of features `[13, H, W]`, 0 where a pixel is missing.
pub fn relative_weight(features: &Image, valid: Option<&Image>, floor: f32) -> Image {
    Image::from_rows(1, features.height(), features.width(), |_, y, row| {
        let z: [&[f32]; 3] = std::array::from_fn(|k| features.row(DENOISED + k, y));
        let valid = valid.map(|v| v.row(0, y));
        for (x, weight) in row.iter_mut().enumerate() {
            let mean = (z[0][x] + z[1][x] + z[2][x]) / 3.0;
            *weight = if valid.is_some_and(|v| v[x] == 0.0) { 0.0 } else { 1.0 / (mean * mean + floor) };
        }
    })
}

/// 1 / (z̄² + 0.01) with z the mean of both halves' z, 0 where a pixel is missing.
///
/// Noise of y^b that the denoiser let through makes z^b bright where y^b is bright. A weight of z^b
/// alone counts such pixels less than those whose noise is dark, and what is fitted to y^b under it
/// comes out too dark; half of z^a halves that. (A weight of z^a alone would be exact, and is noisier.)
pub fn shared_weight(prepared: &Prepared) -> Image {
    let [a, b] = &prepared.halves;
    Image::from_rows(1, prepared.height(), prepared.width(), |_, y, row| {
        let z: [(&[f32], &[f32]); 3] = std::array::from_fn(|k| (a.row(DENOISED + k, y), b.row(DENOISED + k, y)));
        for (x, weight) in row.iter_mut().enumerate() {
            if prepared.is_valid(y * prepared.width() + x) {
                let z = z.map(|(a, b)| 0.5 * a[x] + 0.5 * b[x]);
                let mean = (z[0] + z[1] + z[2]) / 3.0;
                *weight = 1.0 / (mean * mean + RELATIVE_FLOOR);
            }
        }
    })
}

/// The three planes from `first` on.
pub fn triple(features: &Image, first: usize) -> Image {
    Image::from_rows(3, features.height(), features.width(), |k, y, row| {
        row.copy_from_slice(features.row(first + k, y));
    })
}
