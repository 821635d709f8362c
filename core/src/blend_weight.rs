//! How much of a correction is kept, pixel by pixel, as both halves judge each other.
//!
//! With d = μ̂^a - z^a and r = y^b - z^a, E\[r·d\] is the part of the true error that the correction takes away where
//! y^b is unbiased and independent of d and of the weight, so s = Σ r·d / Σ d², summed with the loss's weights over a
//! neighbourhood and both halves, is the best share of the correction there. An outlier's residual r is limited.
//!
//! It is independent of d but for the network's weights, which were trained on both halves: s is somewhat too large. A
//! share made of pixels that were not trained on is not, but with it every picture came out worse (by up to 0.11 of the
//! denoiser's error): the share is applied to the full buffer's correction, which is less noisy than that of the halves
//! and deserves more. The two errors cancel.
//!
//! Halves of different samples count alike here, and in the loss. With 32 + 8 and 48 + 4 samples of four scenes, evidence by the
//! inverse variance of the y compared with cost up to 3 % of the error, since the half of fewer samples has corrections unlike
//! those of the full buffer; by the samples of the half corrected it was within 2 % of this, either way.

use crate::held_out::blind;
use crate::lanes::widest;
use crate::prepare::Prepared;
use crate::residuals::{Residual, Residuals, dot, limited};
use rayon::prelude::*;
use sspc_image::{Image, box_mean};
use sspc_kernels::simd::{Kernel, Simd};

/// Radius of the neighbourhood that judges a pixel; two box means of this radius.
pub const WEIGHT_RADIUS: usize = 15;

/// Largest share of a correction. With 1.3 the error falls by half a hundredth, and pixels turn black or coloured where y
/// of both halves lies far from z: they are carried beyond y.
pub const LARGEST_SHARE: f32 = 1.0;

/// A residual y^b - z^a counts as no longer than this, in the norm of the loss (√w): one firefly would decide over the
/// correction of a thousand pixels around it. (Of 13 frames two gained 8 % by it, one lost 1.5 %. Adding what is cut off where
/// many pixels agree on it gained nothing.)
pub const LARGEST_RESIDUAL: f32 = 5.0;

/// Weighted sums by which a correction is judged, per pixel, both halves and all channels.
pub(crate) struct Evidence {
    /// Σ w r·d
    agreement: Image,
    /// Σ w d²
    size: Image,
}

impl Evidence {
    /// Evidence of corrected `halves`, `[3, H, W]` each, in the method's units.
    pub fn of(prepared: &Prepared, halves: &[Image; 2]) -> Self {
        Self::sum(prepared, [halves], |&Residual { r, d: [d], .. }| (r, d))
    }

    /// The same of the way from corrected `halves` on to `others`, by what is left of the residuals.
    pub fn beyond(prepared: &Prepared, halves: &[Image; 2], others: &[Image; 2]) -> Self {
        let less = |of: [f32; 3], d: [f32; 3]| [0, 1, 2].map(|k| of[k] - d[k]);
        Self::sum(prepared, [halves, others], |&Residual { weight, whole, d: [d, other], .. }| {
            (limited(less(whole, d), weight), less(other, d))
        })
    }

    /// Sums over residuals, of which `way` says how far each is from the truth and which way is judged.
    fn sum<const N: usize>(
        prepared: &Prepared,
        corrected: [&[Image; 2]; N],
        way: impl Fn(&Residual<N>) -> ([f32; 3], [f32; 3]) + Sync,
    ) -> Self {
        let (height, width) = (prepared.height(), prepared.width());
        let mut evidence = Self { agreement: Image::zeros(1, height, width), size: Image::zeros(1, height, width) };
        if height * width == 0 {
            return evidence;
        }
        let residuals = Residuals::new(prepared);
        let agreement = evidence.agreement.plane_mut(0).par_chunks_mut(width);
        let size = evidence.size.plane_mut(0).par_chunks_mut(width);
        agreement.zip(size).enumerate().for_each(|(y, (agreement, size))| {
            widest(AddRow { residuals: &residuals, y, corrected, way: &way, agreement, size });
        });
        evidence
    }

    /// Only what the pixels that were trained on say.
    pub fn without_held_out(mut self) -> Self {
        [&mut self.agreement, &mut self.size].into_iter().for_each(blind);
        self
    }

    /// Σ w r·d / Σ w d², from 0 to [`LARGEST_SHARE`].
    pub fn share(self) -> Image {
        self.share_within(WEIGHT_RADIUS)
    }

    /// The same over two box means of another radius.
    pub fn share_within(self, radius: usize) -> Image {
        let [agreement, size] = [self.agreement, self.size].map(|sums| box_mean(&box_mean(&sums, radius), radius));
        Image::from_rows(1, size.height(), size.width(), |_, y, row| {
            let sums = agreement.row(0, y).iter().zip(size.row(0, y));
            for (share, (agreement, size)) in row.iter_mut().zip(sums) {
                *share = best_share(*agreement, *size);
            }
        })
    }
}

/// Adds what the residuals of a row say of a way.
struct AddRow<'a, const N: usize, W> {
    residuals: &'a Residuals<'a>,
    y: usize,
    corrected: [&'a [Image; 2]; N],
    way: &'a W,
    agreement: &'a mut [f32],
    size: &'a mut [f32],
}

impl<const N: usize, W: Fn(&Residual<N>) -> ([f32; 3], [f32; 3])> Kernel for AddRow<'_, N, W> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { residuals, y, corrected, way, agreement, size } = self;
        residuals.of_row(y, corrected, |residual| {
            let ((r, d), Residual { x, weight, .. }) = (way(&residual), residual);
            agreement[x] += weight * dot(r, d);
            size[x] += weight * dot(d, d);
        });
    }
}

/// Means over the neighbourhood that judges a pixel.
pub(crate) fn around(sums: Image) -> Image {
    // Each image goes when its mean is there.
    let mean = |image: Image| box_mean(&image, WEIGHT_RADIUS);
    mean(mean(sums))
}

/// The share of a correction that takes most of the error away, from Σ w r·d and Σ w d².
pub(crate) fn best_share(agreement: f32, size: f32) -> f32 {
    if size > 0.0 { (agreement / size).clamp(0.0, LARGEST_SHARE) } else { 0.0 }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::differences::Differences;
    use crate::plan::Plan;
    use crate::prepare::Findings;
    use crate::rng::Rng;
    use sspc_image::HalfWeights;
    use sspc_kernels::features::{DENOISED, FEATURE_CHANNELS, FeatureSet, RADIANCE};
    use std::sync::Arc;

    pub(crate) const TRUTH: f32 = 1.0;
    pub(crate) const Z: f32 = 0.5;

    /// Halves without noise: y is the truth, z is grey.
    pub(crate) fn without_noise(height: usize, width: usize) -> Prepared {
        let value = |c, _, _| if c >= DENOISED { Z } else { TRUTH };
        let half = Arc::new(Image::from_fn(FEATURE_CHANNELS, height, width, value));
        Prepared {
            exposure: 1.0,
            halves: [half.clone(), half],
            denoised: Image::filled(3, height, width, Z),
            valid: None,
            set: FeatureSet::NONE,
            plan: Plan::everything(height, width),
            variants: Vec::new(),
            composite: None,
            weights: HalfWeights::EQUAL,
            differences: None,
            found: Findings::default(),
        }
    }

    #[test]
    fn the_share_is_what_of_a_correction_leads_to_the_truth() {
        let prepared = without_noise(4, 6);
        // How far the correction goes, the truth at 1, and the share that is best.
        for (far, best) in [(1.0, 1.0), (2.0, 0.5), (4.0, 0.25), (0.5, LARGEST_SHARE), (-1.0, 0.0), (0.0, 0.0)] {
            let corrected = || Image::filled(3, 4, 6, Z + far * (TRUTH - Z));
            let share = Evidence::of(&prepared, &[corrected(), corrected()]).share();
            assert!(share.data().iter().all(|s| (s - best).abs() < 1e-6), "{far}: {:?}", share.data());
        }
    }

    /// One half's y has a firefly where the correction goes the wrong way by a little.
    #[test]
    fn a_firefly_does_not_decide_over_its_surroundings() {
        let (height, width) = (9, 9);
        let mut prepared = without_noise(height, width);
        let other = Arc::make_mut(&mut prepared.halves[1]);
        (0..3).for_each(|k| other.set(RADIANCE + k, 4, 4, 1e4));
        let corrected = |y, x| if (y, x) == (4, 4) { Z - 0.1 } else { TRUTH };
        let corrected = || Image::from_fn(3, height, width, |_, y, x| corrected(y, x));
        let share = Evidence::of(&prepared, &[corrected(), corrected()]).share();
        assert!(share.data().iter().all(|s| *s > 0.9), "{:?}", share.data());
    }

    #[test]
    fn places_further_apart_than_two_box_means_judge_for_themselves() {
        let reach = 2 * WEIGHT_RADIUS;
        let (prepared, width) = (without_noise(1, 3 * reach), 3 * reach);
        // Too far on the left, just right on the right.
        let corrected = || Image::from_fn(3, 1, width, |_, _, x| if x < width / 2 { 2.0 * TRUTH - Z } else { TRUTH });
        let share = Evidence::of(&prepared, &[corrected(), corrected()]).share();
        let row = share.row(0, 0);
        assert!(row[..width / 2 - reach].iter().all(|s| (s - 0.5).abs() < 1e-5), "{row:?}");
        assert!(row[width / 2 + reach..].iter().all(|s| (s - 1.0).abs() < 1e-5), "{row:?}");
        assert!(row.is_sorted(), "{row:?}");
    }

    /// A frame of noise with noisy differences, and corrected halves of noise.
    pub(crate) fn with_differences(height: usize, width: usize) -> (Prepared, [Image; 2]) {
        let rng = &mut Rng::new(11);
        let mut prepared = without_noise(height, width);
        let mut noise =
            |channels: usize, size: f32| Image::from_fn(channels, height, width, |_, _, _| 0.5 + size * rng.normal());
        prepared.halves = [(); 2].map(|()| Arc::new(noise(FEATURE_CHANNELS, 0.2)));
        let known = Image::from_fn(2, height, width, |axis, y, x| {
            if (y + axis < height) && (x + 1 - axis < width) && (y, x) != (2, 3) { 1.0 } else { 0.0 }
        });
        let halves = [noise(6, 0.3), noise(6, 0.3)];
        let given = Differences::of_known(halves, known, &prepared, 0.7);
        prepared.differences = Some(Arc::new(given));
        (prepared, [noise(3, 0.2), noise(3, 0.2)])
    }

    /// The naive twin: one difference at a time, in f64. Fails with another sign, place, half or weight, and where a limit is
    /// missing.
    #[test]
    fn evidence_of_differences_agrees_with_its_naive_twin() {
        let (height, width) = (6, 9);
        let (mut prepared, halves) = with_differences(height, width);
        // One outlier that is limited.
        let given = Arc::make_mut(prepared.differences.as_mut().expect("differences"));
        given.halves[1].set(4, 2, 5, 500.0);
        let found = Evidence::of(&prepared, &halves);
        let colours = Evidence::of(&Prepared { differences: None, ..prepared.clone() }, &halves);
        let given = prepared.differences.as_ref().expect("differences");
        for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
            let (mut agreement, mut size) = (0.0, 0.0);
            for (axis, (y1, x1)) in [(y, x + 1), (y + 1, x)].into_iter().enumerate() {
                if y1 == height || x1 == width || given.known.at(axis, y, x) == 0.0 {
                    continue;
                }
                for (h, half) in halves.iter().enumerate() {
                    let z = |k: usize, y, x| f64::from(prepared.halves[h].at(DENOISED + k, y, x));
                    let mean = (0..3).map(|k| z(k, y, x)).sum::<f64>() / 3.0;
                    let weight = f64::from(given.weight.at(axis, y, x)) / (mean * mean + 0.01);
                    let step = |k: usize, y, x| f64::from(half.at(k, y, x)) - z(k, y, x);
                    let d = [0, 1, 2].map(|k| step(k, y1, x1) - step(k, y, x));
                    let other = |k: usize| f64::from(given.halves[1 - h].at(3 * axis + k, y, x));
                    let r = [0, 1, 2].map(|k| other(k) - (z(k, y1, x1) - z(k, y, x)));
                    let length = (weight * r.iter().map(|r| r * r).sum::<f64>()).sqrt();
                    let limit = (f64::from(LARGEST_RESIDUAL) / length).min(1.0);
                    agreement += limit * weight * r.iter().zip(d).map(|(r, d)| r * d).sum::<f64>();
                    size += weight * d.iter().map(|d| d * d).sum::<f64>();
                }
            }
            let of_differences = |all: &Image, colours: &Image| f64::from(all.at(0, y, x) - colours.at(0, y, x));
            let close = |found: f64, expected: f64| (found - expected).abs() < 1e-4 * (1.0 + expected.abs());
            let found_agreement = of_differences(&found.agreement, &colours.agreement);
            assert!(close(found_agreement, agreement), "{y} {x}: {found_agreement} {agreement}");
            let found_size = of_differences(&found.size, &colours.size);
            assert!(close(found_size, size), "{y} {x}: {found_size} {size}");
        }
    }

    /// Bands are read with so many rows around them ([`crate::compose::Composer::margin`]).
    #[test]
    fn what_differences_say_reaches_no_further_than_bands_do() {
        let (height, width, changed) = (30, 5, 15);
        let (mut prepared, halves) = with_differences(height, width);
        // Colours alone decide over their own row.
        let of_differences = |prepared: &Prepared| {
            let all = Evidence::of(prepared, &halves);
            let colours = Evidence::of(&Prepared { differences: None, ..prepared.clone() }, &halves);
            [(all.agreement, colours.agreement), (all.size, colours.size)]
                .map(|(all, colours)| Image::from_fn(1, height, width, |_, y, x| all.at(0, y, x) - colours.at(0, y, x)))
        };
        let before = of_differences(&prepared);
        let given = prepared.differences.clone().expect("differences");
        let (mut of_halves, mut known) = (given.halves.clone(), given.known.clone());
        for x in 0..width {
            (0..3).for_each(|c| Arc::make_mut(&mut prepared.halves[0]).set(RADIANCE + c, changed, x, 3.0));
            (0..3).for_each(|c| Arc::make_mut(&mut prepared.halves[0]).set(DENOISED + c, changed, x, 2.0));
            (0..6).for_each(|c| of_halves[0].set(c, changed, x, -1.0));
            // A difference to the row below is not known where that is missing.
            known.set(1, changed - 1, x, 0.0);
        }
        prepared.differences = Some(Arc::new(Differences::of_known(of_halves, known, &prepared, 0.7)));
        let after = of_differences(&prepared);
        let differs = |y: usize| before.iter().zip(&after).any(|(before, after)| before.row(0, y) != after.row(0, y));
        let rows: Vec<usize> = (0..height).filter(|&y| differs(y)).collect();
        let farthest = rows.iter().map(|y| y.abs_diff(changed)).max();
        assert_eq!(farthest, Some(3), "{rows:?}");
        assert!(farthest <= Some(crate::compose::DIFFERENCES_REACH), "rows of a band would be missing");
    }
}
