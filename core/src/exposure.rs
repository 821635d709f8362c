//! The factor that brings a frame to the method's scale: its constants (0.01, log(1 + d)) are made for renders of about
//! one brightness.
//!
//! Taken over all pixels, a dark background decides it: for an object on 1.6 % of the picture before one of 1e-5 the
//! factor was 25 000, and its error over the denoiser's rose from 0.46 to 0.98. So it is taken over pixels that have
//! noise to mend. (On 24 renders of three renderers this moves it by less than a third, but where half of the picture is
//! empty or black.)

use rayon::prelude::*;

/// Mean of the darker 95 % of the positive z̄ that is aimed at.
const TARGET_MEAN: f64 = 0.25;
/// Share of the pixels that count: emitters seen directly do not.
const EXPOSED_SHARE: f64 = 0.95;
/// A pixel has noise to mend when it has this share of the noise beyond which half of all noise lies.
const LEAST_NOISE: f32 = 0.01;

/// A pixel's brightness and noise.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NoisyPixel {
    /// z̄, the mean of both halves and the three channels; positive.
    pub mean: f32,
    /// Mean of |y^a - y^b| over the channels, but no more than z̄: outliers would decide it.
    pub noise: f32,
}

/// 0.25 over the mean of the darker 95 % of some positive z̄; 1 of none.
pub(crate) fn of_all(mut means: Vec<f64>) -> f32 {
    let count = ((means.len() as f64 * EXPOSED_SHARE).ceil() as usize).max(1).min(means.len());
    if 0 < count && count < means.len() {
        means.select_nth_unstable_by(count - 1, f64::total_cmp);
    }
    let mean = means[..count].iter().sum::<f64>() / count.max(1) as f64;
    // Beyond this range the squares of exposures and radiances leave f32.
    let factor = (TARGET_MEAN / mean).clamp(1e-12, 1e12);
    if factor.is_finite() && count > 0 { factor as f32 } else { 1.0 }
}

/// The same over the pixels that have noise to mend; over all where none has any.
pub(crate) fn of_noisy(pixels: &[NoisyPixel]) -> f32 {
    let least = LEAST_NOISE * typical_noise(pixels);
    of_all(pixels.iter().filter(|pixel| pixel.noise >= least).map(|pixel| f64::from(pixel.mean)).collect())
}

/// The noise that half of all noise exceeds: the median over pixels, each as often as it is noisy.
fn typical_noise(pixels: &[NoisyPixel]) -> f32 {
    let mut noise: Vec<f32> = pixels.iter().map(|pixel| pixel.noise).collect();
    noise.par_sort_unstable_by(f32::total_cmp);
    let half = 0.5 * noise.iter().map(|v| f64::from(*v)).sum::<f64>();
    let mut below = 0.0;
    let exceeded = noise.iter().find(|v| {
        below += f64::from(**v);
        below >= half
    });
    exceeded.copied().unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An object of 1.6 % of the picture before a background.
    fn picture(background: f32) -> Vec<NoisyPixel> {
        let of = |mean: f32| NoisyPixel { mean, noise: 0.5 * mean };
        (0..10_000).map(|i| of(if i < 160 { 0.5 } else { background })).collect()
    }

    #[test]
    fn a_dark_background_does_not_decide() {
        for background in [1e-6, 1e-5, 1e-4, 1e-3] {
            assert_eq!(of_noisy(&picture(background)), 0.5, "{background}");
        }
        assert!(of_all(picture(1e-5).iter().map(|pixel| f64::from(pixel.mean)).collect()) > 1e4);
    }

    #[test]
    fn where_all_is_noisy_or_nothing_is_both_rules_agree() {
        let ramp = |noise: fn(f32) -> f32| -> Vec<NoisyPixel> {
            let of = |mean: f32| NoisyPixel { mean, noise: noise(mean) };
            (1..1000).map(|i| of(i as f32 * 0.001)).collect()
        };
        for pixels in [ramp(|mean| 0.1 * mean.max(0.1)), ramp(|_| 0.0)] {
            assert_eq!(of_noisy(&pixels), of_all(pixels.iter().map(|pixel| f64::from(pixel.mean)).collect()));
        }
        assert_eq!(of_noisy(&[]), 1.0);
    }
}
