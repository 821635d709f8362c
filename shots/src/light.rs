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

/// ℓ of a half's denoised picture `[3, H, W]`: `[1, H, W]`.
pub fn brightness(denoised: &Image) -> Image {
    let (height, width) = (denoised.height(), denoised.width());
    let mut brightness = Image::zeros(1, height, width);
    brightness.for_each_row(|_, y, row| {
        let rows = y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(height);
        let mut sums = vec![0.0f32; width];
        for line in rows.clone().flat_map(|y| (0..3).map(move |c| denoised.row(c, y))) {
            sums.iter_mut().zip(line).for_each(|(sum, value)| *sum += value);
        }
        for (x, mean) in row.iter_mut().enumerate() {
            let columns = x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(width);
            let values = (3 * rows.len() * columns.len()) as f32;
            *mean = sums[columns].iter().sum::<f32>() / values;
        }
    });
    brightness
}

/// φ² of a frame, of the [`brightness`] of both halves: `[1, H, W]`.
///
/// # Panics
/// When sizes differ.
pub fn flicker(mut a: Image, b: &Image) -> Image {
    assert!(a.same_size(b), "halves of one size");
    a.for_each_row(|_, y, row| {
        for (a, b) in row.iter_mut().zip(b.row(0, y)) {
            *a = (*a - b) * (*a - b);
        }
    });
    box_mean(&a, FLICKER_RADIUS)
}

/// Lessens `valid`, `[1, H, W]`, where the neighbour, of [`brightness`] `other` and [`flicker`] `flicker`, lies in other light than this
/// frame's half of brightness `own`. Values that are not finite say nothing.
///
/// # Panics
/// When sizes differ.
pub fn keep_same(own: &Image, other: &Image, flicker: &Image, field: &Field, valid: &mut Image) {
    assert!([own, other, flicker, &*valid].iter().all(|image| image.same_size(field)), "a neighbour of one size");
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
