//! Whether a pixel of the neighbour lies in the same light, as far as the denoiser's flicker lets anyone say.
//!
//! With ℓ the brightness of z of a half, the mean of its channels over 3x3 pixels, and φ² the mean of (ℓ^a - ℓ^b)² over 9x9:
//!
//! ```text
//! d = √max( 0, (ℓ - Wℓ)² - 4 Wφ² ) / max( ℓ, Wℓ ),     v ← v · clamp( (0.5 - d) / 0.3, 0, 1 )
//! ```
//!
//! φ is of the neighbour, so that nothing of this frame's other half decides what a half sees. Twice φ is left alone:
//! without it the flicker of dark places is taken for a change, and the mean loses what it is made for.

use crate::field::Field;
use crate::warp::{Taps, bilinear, for_rows};
use sspc_image::{Image, box_mean};

/// Radius of the pixels over which brightness is averaged.
const RADIUS: usize = 1;
/// Radius of the pixels over which flicker is averaged.
const FLICKER_RADIUS: usize = 4;
/// Squared differences of brightness of less than so much of φ² are flicker.
const FLICKER: f32 = 4.0;
/// Relative difference from which on the light is another.
const OTHER: f32 = 0.5;
/// From there to the difference that leaves v as it is.
const FADE: f32 = 0.3;

/// A frame's light.
pub struct Light {
    /// ℓ of both halves, `[1, H, W]`.
    brightness: [Image; 2],
    /// φ², `[1, H, W]`.
    flicker: Image,
}

impl Light {
    /// Of the [`brightness`] of both halves.
    ///
    /// # Panics
    /// When sizes differ.
    pub fn of(brightness: [Image; 2]) -> Self {
        let [a, b] = &brightness;
        assert!(a.same_size(b), "halves of one size");
        let mut apart = a.clone();
        apart.for_each_row(|_, y, row| {
            for (a, b) in row.iter_mut().zip(b.row(0, y)) {
                *a = (*a - b) * (*a - b);
            }
        });
        Self { flicker: box_mean(&apart, FLICKER_RADIUS), brightness }
    }

    /// Lessens `valid`, `[1, H, W]`, where half `half` of the neighbour lies in other light than this frame's. Values that are not
    /// finite say nothing.
    ///
    /// # Panics
    /// When sizes differ.
    pub fn keep_same(&self, neighbour: &Light, half: usize, field: &Field, valid: &mut Image) {
        let (own, other, flicker) = (&self.brightness[half], &neighbour.brightness[half], &neighbour.flicker);
        assert!([own, other, &*valid].iter().all(|image| image.same_size(field)), "a neighbour of one size");
        let (height, width) = (field.height(), field.width());
        for_rows(&mut [valid], |y, rows| {
            let (dx, dy, own) = (field.row(0, y), field.row(1, y), own.row(0, y));
            for (x, v) in rows[0].iter_mut().enumerate().filter(|(_, v)| **v > 0.0) {
                let Some(taps) = Taps::at(x as f32 + dx[x], y as f32 + dy[x], height, width) else { continue };
                let of = |plane: &Image| bilinear(plane.plane(0), width, &taps);
                let share = share_of(own[x], of(other), of(flicker));
                *v *= if share.is_nan() { 1.0 } else { share };
            }
        });
    }
}

/// ℓ of a half's denoised picture `[3, H, W]`: `[1, H, W]`.
pub fn brightness(denoised: &Image) -> Image {
    let mut mean = Image::zeros(1, denoised.height(), denoised.width());
    mean.for_each_row(|_, y, row| {
        let [r, g, b] = [0, 1, 2].map(|c| denoised.row(c, y));
        for (x, mean) in row.iter_mut().enumerate() {
            *mean = (r[x] + g[x] + b[x]) / 3.0;
        }
    });
    box_mean(&mean, RADIUS)
}

/// What of v stays between places of this brightness; NaN where that is not known.
#[inline(always)]
fn share_of(own: f32, other: f32, flicker: f32) -> f32 {
    let apart = (own - other) * (own - other) - FLICKER * flicker;
    let brighter = if own > other { own } else { other };
    // Also where both are black.
    if apart <= 0.0 {
        return 1.0;
    }
    ((OTHER - apart.sqrt() / brighter) / FADE).clamp(0.0, 1.0)
}
