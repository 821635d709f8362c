//! Keeps the picture near what both corrected halves say.
//!
//! The denoiser's picture of the full buffer is less noisy than those of the halves, and so is its correction; but a
//! firefly that it takes for a detail stays in it whole, where the halves agree on something else. Two halves with errors
//! of one size and independent signs differ by about as much as their mean differs from the picture. So where the picture
//! is further from the mean than that, around a pixel, it is brought nearer; and no pixel leaves the halves' range by more
//! than twice what they differ by close to it.

use crate::box_mean::box_mean;
use crate::objective::{RELATIVE_FLOOR, weight_of};
use crate::prepare::Prepared;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;

/// Radius of the box in which squared distances are averaged, pixels: what a pixel's limit depends on.
pub(crate) const LIMIT_RADIUS: usize = 8;
/// How many times the halves' mean squared distance from their mean the picture's may be.
const TIMES_AROUND: f32 = 3.0;
/// Radius of the box in which the halves' difference is averaged for a pixel's own limit.
const CLOSE_RADIUS: usize = 2;
/// How many times that difference a pixel may leave the halves' range by.
const TIMES_CLOSE: f32 = 2.0;
/// Shares below this leave the denoiser's picture as it is.
const LEAST_SHARE: f32 = 1e-3;

/// Changes a `picture` `[3, H, W]`, of which z + share (picture - z) enters, so that this lies near both halves'
/// z + share (μ̂ - z); where nothing of the correction is used, it stays.
pub(crate) fn limit_outliers(prepared: &Prepared, halves: &[Image; 2], share: &Image, picture: &mut Image) {
    let blended = [0, 1].map(|h| with_share(&prepared.halves[h], DENOISED, &halves[h], share));
    let whole = with_share(&prepared.denoised, 0, picture, share);
    let [a, b] = &blended;
    let per_pixel = |of: &(dyn Fn([f32; 3], [f32; 3], [f32; 3]) -> f32 + Sync)| {
        Image::from_rows(1, share.height(), share.width(), |_, y, row| {
            for (x, value) in row.iter_mut().enumerate() {
                let pixel = |image: &Image| [0, 1, 2].map(|k| image.at(k, y, x));
                *value = of(pixel(a), pixel(b), pixel(&whole));
            }
        })
    };
    let relative = |a: [f32; 3], b: [f32; 3], distance: &dyn Fn(usize, f32) -> f32| {
        let mean = [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]));
        (0..3).map(|k| distance(k, mean[k]).powi(2)).sum::<f32>() * weight_of(mean, RELATIVE_FLOOR)
    };
    let of_picture = per_pixel(&|a, b, x| relative(a, b, &|k, mean| x[k] - mean));
    let of_halves = per_pixel(&|a, b, _| relative(a, b, &|k, mean| a[k] - mean));
    let close = per_pixel(&|a, b, _| (0..3).map(|k| (a[k] - b[k]).abs()).sum::<f32>() / 3.0);
    let [of_picture, of_halves] = [of_picture, of_halves].map(|image| box_mean(&image, LIMIT_RADIUS));
    let close = box_mean(&close, CLOSE_RADIUS);
    picture.for_each_row(|k, y, row| {
        for (x, g) in row.iter_mut().enumerate() {
            let share = share.at(0, y, x);
            if share < LEAST_SHARE {
                continue;
            }
            let (a, b, value) = (a.at(k, y, x), b.at(k, y, x), whole.at(k, y, x));
            let (far, allowed) = (of_picture.at(0, y, x), TIMES_AROUND * of_halves.at(0, y, x));
            let mean = 0.5 * (a + b);
            let nearer = if far > allowed { mean + allowed / far * (value - mean) } else { value };
            let margin = TIMES_CLOSE * close.at(0, y, x);
            let limited = nearer.max(a.min(b) - margin).min(a.max(b) + margin);
            if limited != value {
                let z = prepared.denoised.at(k, y, x);
                *g = z + (limited - z) / share;
            }
        }
    });
}

/// z + share (corrected - z), where z is the planes of `denoised` from `first` on.
fn with_share(denoised: &Image, first: usize, corrected: &Image, share: &Image) -> Image {
    Image::from_rows(3, share.height(), share.width(), |k, y, row| {
        let (z, corrected, share) = (denoised.row(first + k, y), corrected.row(k, y), share.row(0, y));
        for (x, out) in row.iter_mut().enumerate() {
            *out = z[x] + share[x] * (corrected[x] - z[x]);
        }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::prepare::Findings;
    use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
    use std::sync::Arc;

    const SIZE: (usize, usize) = (12, 14);

    /// Halves whose z is 1, full buffer too but for a firefly.
    fn with_firefly(value: f32) -> Prepared {
        let half = || Arc::new(Image::filled(FEATURE_CHANNELS, SIZE.0, SIZE.1, 1.0));
        let mut denoised = Image::filled(3, SIZE.0, SIZE.1, 1.0);
        denoised.set(0, 6, 7, value);
        Prepared {
            exposure: 1.0,
            halves: [half(), half()],
            denoised,
            valid: None,
            set: FeatureSet::NONE,
            variants: Vec::new(),
            plan: Plan::everything(SIZE.0, SIZE.1),
            found: Findings::default(),
        }
    }

    fn limited(firefly: f32, halves: [f32; 2], share: f32) -> f32 {
        let prepared = with_firefly(firefly);
        let halves = halves.map(|value| Image::filled(3, SIZE.0, SIZE.1, value));
        let share = Image::filled(1, SIZE.0, SIZE.1, share);
        let mut picture = prepared.denoised.clone();
        limit_outliers(&prepared, &halves, &share, &mut picture);
        let z = prepared.denoised.at(0, 6, 7);
        z + share.at(0, 6, 7) * (picture.at(0, 6, 7) - z)
    }

    #[test]
    fn a_firefly_of_the_full_buffer_comes_down_to_what_the_halves_allow() {
        // The halves say 0.9 and 1.1: their range, and twice 0.2 beyond, or nearer.
        assert!((1.0..=1.5001).contains(&limited(50.0, [0.9, 1.1], 1.0)), "{}", limited(50.0, [0.9, 1.1], 1.0));
        assert!((limited(0.0, [0.9, 1.1], 1.0) - 0.5).abs() < 1e-5);
        assert_eq!(limited(1.4, [0.9, 1.1], 1.0), 1.4, "within the margin nothing changes");
    }

    #[test]
    fn where_no_correction_is_used_the_denoisers_picture_stays() {
        assert_eq!(limited(50.0, [0.9, 1.1], 0.0), 50.0);
    }

    #[test]
    fn halves_that_agree_leave_no_margin() {
        assert!((limited(50.0, [1.0, 1.0], 0.5) - 1.0).abs() < 1e-5);
    }
}
