//! Keeps the picture near what both corrected halves say.
//!
//! The denoiser's picture of the full buffer is less noisy than those of the halves, and so is its correction; but a
//! firefly that it takes for a detail stays in it whole, at a pixel where the halves agree on something else. So the
//! picture may leave the range of the corrected halves by no more than they disagree around the pixel.

use crate::box_mean::box_mean;
use crate::prepare::Prepared;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;

/// Radius of the box in which the halves' disagreement is averaged, pixels.
pub(crate) const LIMIT_RADIUS: usize = 2;
/// How many times the disagreement the picture may leave the halves' range by.
const TIMES: f32 = 2.0;
/// Shares below this leave the denoiser's picture as it is.
const LEAST_SHARE: f32 = 1e-3;

/// Changes an uncorrected-by-share `picture` `[3, H, W]` so that z + share (picture - z) lies within the range of both
/// halves' z + share (μ̂ - z), widened by twice their mean difference around the pixel; where nothing of the correction
/// is used, it stays.
pub(crate) fn limit_outliers(prepared: &Prepared, halves: &[Image; 2], share: &Image, picture: &mut Image) {
    let blended = |h: usize, k: usize, y: usize, x: usize| {
        let z = prepared.halves[h].at(DENOISED + k, y, x);
        z + share.at(0, y, x) * (halves[h].at(k, y, x) - z)
    };
    let difference = Image::from_rows(1, share.height(), share.width(), |_, y, row| {
        for (x, d) in row.iter_mut().enumerate() {
            *d = (0..3).map(|k| (blended(0, k, y, x) - blended(1, k, y, x)).abs()).sum::<f32>() / 3.0;
        }
    });
    let difference = box_mean(&difference, LIMIT_RADIUS);
    picture.for_each_row(|k, y, row| {
        for (x, g) in row.iter_mut().enumerate() {
            let share = share.at(0, y, x);
            if share < LEAST_SHARE {
                continue;
            }
            let (a, b, margin) = (blended(0, k, y, x), blended(1, k, y, x), TIMES * difference.at(0, y, x));
            let z = prepared.denoised.at(k, y, x);
            let value = z + share * (*g - z);
            let limited = value.max(a.min(b) - margin).min(a.max(b) + margin);
            if limited != value {
                *g = z + (limited - z) / share;
            }
        }
    });
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
        // The halves say 0.9 and 1.1: their range, and twice 0.2 beyond.
        assert!((limited(50.0, [0.9, 1.1], 1.0) - 1.5).abs() < 1e-5);
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
