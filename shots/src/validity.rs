//! How far a pixel of the neighbour shows the same thing, by features.
//!
//! ```text
//! v_c = inside · exp( -0.3 (8 ‖ρ_c - Wρ‖² + 2 ‖n_c - Wn‖²) )
//! ```
//!
//! Weak on purpose: the mean's noise is lower wherever something is averaged, and the correction takes its bias away. What z
//! says, beyond its flicker, is in [`light`](crate::light).

use crate::field::Field;
use crate::warp::{Taps, bilinear, for_rows};
use sspc_image::Image;

/// Factor of the exponent.
pub const STRENGTH: f32 = 0.3;
/// Weight of the squared distance of albedo.
pub const ALBEDO_WEIGHT: f32 = 8.0;
/// Weight of the squared distance of normals.
pub const NORMAL_WEIGHT: f32 = 2.0;

/// What guides the comparison: the features of one buffer of a frame, each where it is there.
#[derive(Clone, Copy, Debug, Default)]
pub struct Guides<'a> {
    /// ρ `[3, H, W]`.
    pub albedo: Option<&'a Image>,
    /// n `[3, H, W]`.
    pub normal: Option<&'a Image>,
}

impl<'a> Guides<'a> {
    /// Features that both have, with their weights.
    pub(crate) fn pairs(&self, other: &Guides<'a>) -> Vec<(f32, &'a Image, &'a Image)> {
        let albedo = self.albedo.zip(other.albedo).map(|(own, other)| (ALBEDO_WEIGHT, own, other));
        let normal = self.normal.zip(other.normal).map(|(own, other)| (NORMAL_WEIGHT, own, other));
        albedo.into_iter().chain(normal).collect()
    }
}

/// v of every pixel, `[1, H, W]`, 0..1. A feature that is not finite on either side says nothing there.
///
/// # Panics
/// When sizes differ.
pub fn validity<'a>(centre: &Guides<'a>, neighbour: &Guides<'a>, field: &Field) -> Image {
    let pairs = centre.pairs(neighbour);
    assert!(pairs.iter().all(|(_, own, other)| own.same_size(field) && other.same_size(field)), "guides of one size");
    let (height, width) = (field.height(), field.width());
    let of_pair = |&(weight, own, other): &(f32, &'a Image, &'a Image)| {
        (0..own.channels()).map(move |c| (weight, own.plane(c), other.plane(c)))
    };
    let planes: Vec<(f32, &[f32], &[f32])> = pairs.iter().flat_map(of_pair).collect();
    let mut valid = Image::zeros(1, height, width);
    for_rows(&mut [&mut valid], |y, rows| {
        let (dx, dy) = (field.row(0, y), field.row(1, y));
        let first = y * width;
        for (x, v) in rows[0].iter_mut().enumerate() {
            let Some(taps) = Taps::at(x as f32 + dx[x], y as f32 + dy[x], height, width) else { continue };
            let mut distance = 0.0f32;
            for (weight, own, other) in &planes {
                let apart = own[first + x] - bilinear(other, width, &taps);
                distance += weight * apart * apart;
            }
            if !distance.is_finite() {
                distance = pairs.iter().map(|pair| finite_distance(pair, first + x, &taps)).sum();
            }
            *v = (-STRENGTH * distance).exp();
        }
    });
    valid
}

/// Squared distance of one feature times its weight, 0 where it is not finite.
fn finite_distance((weight, own, other): &(f32, &Image, &Image), at: usize, taps: &Taps) -> f32 {
    let squares = (0..own.channels()).map(|c| {
        let apart = own.plane(c)[at] - bilinear(other.plane(c), own.width(), taps);
        apart * apart
    });
    let distance = weight * squares.sum::<f32>();
    if distance.is_finite() { distance } else { 0.0 }
}
