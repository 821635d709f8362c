//! The factor that brings a frame to the method's scale: its constants (0.01, log(1 + d)) are made for renders of about
//! one brightness.
//!
//! Taken over all pixels, a dark background decides it: for an object on 1.6 % of the picture before one of 1e-5 the
//! factor was 25 000, and its error over the denoiser's rose from 0.46 to 0.98. So it is taken over pixels that have
//! noise to mend. (On 24 renders of three renderers this moves it by less than a third, but where half of the picture is
//! empty or black.)

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
pub(crate) fn of_all(means: &[f64]) -> f32 {
    let count = ((means.len() as f64 * EXPOSED_SHARE).ceil() as usize).max(1).min(means.len());
    let classes = Classes::of(means);
    let mut below = Class::default();
    // What is below the class that the last of them lies in, and the least of that class.
    let sum = match classes.0.iter().position(|class| {
        let reached = below.count + class.count >= count;
        below = if reached { below } else { below.and(class) };
        reached
    }) {
        Some(last) => below.sum + in_order(means, last).take(count - below.count).sum::<f64>(),
        None => 0.0,
    };
    // Beyond this range the squares of exposures and radiances leave f32.
    let factor = (TARGET_MEAN * count as f64 / sum).clamp(1e-12, 1e12);
    if factor.is_finite() && count > 0 { factor as f32 } else { 1.0 }
}

/// The same over the pixels that have noise to mend; over all where none has any.
pub(crate) fn of_noisy(pixels: &[NoisyPixel]) -> f32 {
    let least = LEAST_NOISE * typical_noise(pixels);
    let noisy = pixels.iter().filter(|pixel| pixel.noise >= least);
    of_all(&noisy.map(|pixel| f64::from(pixel.mean)).collect::<Vec<_>>())
}

/// The noise that half of all noise exceeds: the median over pixels, each as often as it is noisy.
fn typical_noise(pixels: &[NoisyPixel]) -> f32 {
    let noise: Vec<f64> = pixels.iter().map(|pixel| f64::from(pixel.noise)).collect();
    let classes = Classes::of(&noise);
    let half = 0.5 * classes.0.iter().map(|class| class.sum).sum::<f64>();
    let mut below = 0.0;
    for (at, class) in classes.0.iter().enumerate().filter(|(_, class)| class.count > 0) {
        if below + class.sum >= half {
            let mut sum = below;
            let reaches = |value: &f64| {
                sum += value;
                sum >= half
            };
            // Rounded otherwise in the end, the sum may stay below by its last bit.
            let values: Vec<f64> = in_order(&noise, at).collect();
            return values.iter().copied().find(reaches).or(values.last().copied()).unwrap_or(0.0) as f32;
        }
        below += class.sum;
    }
    0.0
}

/// Leading bits of an f32 that make its class: sign, exponent and four bits more.
const CLASS_BITS: u32 = 13;

/// How many values a class has, and their sum.
#[derive(Clone, Copy, Default)]
struct Class {
    count: usize,
    sum: f64,
}

impl Class {
    fn and(self, other: &Self) -> Self {
        Self { count: self.count + other.count, sum: self.sum + other.sum }
    }
}

/// Values that are not negative, in classes of rising size: what lies among them need not be sorted where few of them are
/// asked for.
struct Classes(Vec<Class>);

impl Classes {
    fn of(values: &[f64]) -> Self {
        let mut classes = vec![Class::default(); 1 << CLASS_BITS];
        for value in values {
            let class = &mut classes[class_of(*value)];
            class.count += 1;
            class.sum += value;
        }
        Self(classes)
    }
}

fn class_of(value: f64) -> usize {
    ((value as f32).to_bits() >> (u32::BITS - CLASS_BITS)) as usize
}

/// The values of one class, from the least on.
fn in_order(values: &[f64], class: usize) -> impl Iterator<Item = f64> {
    let mut of_class: Vec<f64> = values.iter().copied().filter(|value| class_of(*value) == class).collect();
    of_class.sort_unstable_by(f64::total_cmp);
    of_class.into_iter()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An object of 1.6 % of the picture before a background.
    fn picture(background: f32) -> Vec<NoisyPixel> {
        let of = |mean: f32| NoisyPixel { mean, noise: 0.5 * mean };
        (0..10_000).map(|i| of(if i < 160 { 0.5 } else { background })).collect()
    }

    fn means(pixels: &[NoisyPixel]) -> Vec<f64> {
        pixels.iter().map(|pixel| f64::from(pixel.mean)).collect()
    }

    #[test]
    fn a_dark_background_does_not_decide() {
        for background in [1e-6, 1e-5, 1e-4, 1e-3] {
            assert_eq!(of_noisy(&picture(background)), 0.5, "{background}");
        }
        assert!(of_all(&means(&picture(1e-5))) > 1e4);
    }

    #[test]
    fn where_all_is_noisy_or_nothing_is_both_rules_agree() {
        let ramp = |noise: fn(f32) -> f32| -> Vec<NoisyPixel> {
            let of = |mean: f32| NoisyPixel { mean, noise: noise(mean) };
            (1..1000).map(|i| of(i as f32 * 0.001)).collect()
        };
        for pixels in [ramp(|mean| 0.1 * mean.max(0.1)), ramp(|_| 0.0)] {
            assert_eq!(of_noisy(&pixels), of_all(&means(&pixels)));
        }
        assert_eq!(of_noisy(&[]), 1.0);
    }

    /// All values sorted, as the equations say it.
    #[test]
    fn classes_find_what_sorting_finds() {
        let rng = &mut crate::rng::Rng::new(3);
        for count in [1, 2, 19, 20, 21, 1000] {
            for spread in [0.0, 0.01, 1.0, 20.0] {
                let mut of = || (spread * rng.normal()).exp();
                let pixels: Vec<_> = (0..count).map(|_| NoisyPixel { mean: of(), noise: of() }).collect();
                let sorted = |of: fn(&NoisyPixel) -> f32| {
                    let mut values: Vec<f64> = pixels.iter().map(|pixel| f64::from(of(pixel))).collect();
                    values.sort_unstable_by(f64::total_cmp);
                    values
                };
                let darker = &sorted(|pixel| pixel.mean)[..(count as f64 * EXPOSED_SHARE).ceil() as usize];
                let expected = TARGET_MEAN / (darker.iter().sum::<f64>() / darker.len() as f64);
                let found = f64::from(of_all(&means(&pixels)));
                assert!(
                    (found / expected.clamp(1e-12, 1e12) - 1.0).abs() < 1e-6,
                    "{count} {spread}: {found} {expected}"
                );
                let noise = sorted(|pixel| pixel.noise);
                let half = 0.5 * noise.iter().sum::<f64>();
                let at = (1..=count).find(|n| noise[..*n].iter().sum::<f64>() >= half).unwrap_or(count);
                let found = f64::from(typical_noise(&pixels));
                // By rounding half of all may be reached one value earlier or later.
                assert!(noise[at.saturating_sub(2)..(at + 1).min(count)].contains(&found), "{count} {spread}: {found}");
            }
        }
    }
}
