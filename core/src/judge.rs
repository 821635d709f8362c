//! How much of a correction is kept, pixel by pixel, as both halves judge each other.
//!
//! With d = μ̂^a - z^a and r = y^b - z^a, E\[r·d\] is the part of the true error that the
//! correction takes away (y^b is unbiased and independent of d), so s = Σ r·d / Σ d², summed with the
//! loss's weights over a neighbourhood and both halves, is the best share of the correction there.
//! Noise of y^b makes the first sum uncertain; the correction is cut back only as far as its sum
//! says by more than one standard error, since the network was already trained not to overdo it.

use crate::features::{DENOISED, RADIANCE};
use crate::image::Image;
use crate::objective::shared_weight;
use crate::prepare::Prepared;
use crate::smooth::box_mean;

/// Radius of the neighbourhood that judges a pixel; two box means of this radius.
pub(crate) const JUDGE_RADIUS: usize = 15;
/// Standard errors by which a share must be below 1 before it counts.
const JUDGE_DOUBT: f64 = 1.0;
/// Pixels that two box means of radius R weigh together: their kernel's 1 / Σk².
const JUDGE_SAMPLES: f64 = 2.25 * ((2 * JUDGE_RADIUS + 1) * (2 * JUDGE_RADIUS + 1)) as f64;

/// Weighted sums by which a correction is judged, per pixel, both halves and all channels.
pub(crate) struct Evidence {
    /// Σ w r·d
    agreement: Image,
    /// Σ w d²
    size: Image,
}

impl Evidence {
    pub fn of(prepared: &Prepared, halves: &[Image; 2]) -> Self {
        let (height, width) = (prepared.height(), prepared.width());
        let weight = shared_weight(prepared);
        let sum = |of: fn(f32, f32) -> f32| {
            Image::from_rows(1, height, width, |_, y, row| {
                for (h, k) in (0..2).flat_map(|h| (0..3).map(move |k| (h, k))) {
                    let (own, other) = (&prepared.halves[h], &prepared.halves[1 - h]);
                    let (z, target, weight) = (own.row(DENOISED + k, y), other.row(RADIANCE + k, y), weight.row(0, y));
                    let corrected = halves[h].row(k, y);
                    for x in 0..width {
                        let d = corrected[x] - z[x];
                        row[x] += weight[x] * of(target[x] - z[x], d) * d;
                    }
                }
            })
        };
        Self { agreement: sum(|r, _| r), size: sum(|_, d| d) }
    }

    /// min(1, (Σ w r·d + standard error) / Σ w d²), floored at 0.
    pub fn share(self) -> Image {
        let Self { agreement, size } = self;
        // Squares of more than this would overflow f32.
        let squared = Image::from_rows(1, size.height(), size.width(), |_, y, row| {
            row.iter_mut().zip(agreement.row(0, y)).for_each(|(s, v)| *s = v.clamp(-1e18, 1e18).powi(2));
        });
        // Each image goes when its mean is there.
        let mean = |image: Image| box_mean(&image, JUDGE_RADIUS);
        let pool = |image: Image| mean(mean(image));
        let (agreement, size, squared) = (pool(agreement), pool(size), pool(squared));
        // Share of a pixel's neighbourhood that lies inside the picture, along one side.
        let inside = |i: usize, n: usize| {
            ((i + JUDGE_RADIUS + 1).min(n) - i.saturating_sub(JUDGE_RADIUS)) as f64 / (2 * JUDGE_RADIUS + 1) as f64
        };
        let share = |y: usize, x: usize| {
            let d = f64::from(size.at(0, y, x));
            if d <= 0.0 {
                return 0.0;
            }
            let samples = (JUDGE_SAMPLES * inside(y, size.height()) * inside(x, size.width())).max(1.0);
            let error = (f64::from(squared.at(0, y, x)).max(0.0) / samples).sqrt();
            ((f64::from(agreement.at(0, y, x)) + JUDGE_DOUBT * error) / d).clamp(0.0, 1.0) as f32
        };
        Image::from_rows(1, size.height(), size.width(), |_, y, row| {
            row.iter_mut().enumerate().for_each(|(x, s)| *s = share(y, x));
        })
    }
}
