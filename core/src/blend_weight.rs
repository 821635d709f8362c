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

use crate::box_mean::box_mean;
use crate::held_out::blind;
use crate::objective::own_weight;
use crate::prepare::Prepared;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::DENOISED;

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
        Self::between(prepared, |h, k, y| prepared.halves[h].row(DENOISED + k, y), |h, k, y| halves[h].row(k, y))
    }

    /// The same of the way between two pictures of each half, whose rows of half `h` and channel `k` are `from(h, k, y)` and
    /// `to(h, k, y)`: d = to - from, r = y of the other half - from.
    pub fn between<'p>(
        prepared: &Prepared,
        from: impl Fn(usize, usize, usize) -> &'p [f32] + Sync,
        to: impl Fn(usize, usize, usize) -> &'p [f32] + Sync,
    ) -> Self {
        let (height, width) = (prepared.height(), prepared.width());
        let mut evidence = Self { agreement: Image::zeros(1, height, width), size: Image::zeros(1, height, width) };
        if height * width == 0 {
            return evidence;
        }
        let weights = [0, 1].map(|h| own_weight(prepared, h));
        let agreement = evidence.agreement.plane_mut(0).par_chunks_mut(width);
        let size = evidence.size.plane_mut(0).par_chunks_mut(width);
        agreement.zip(size).enumerate().for_each(|(y, (agreement, size))| {
            for h in 0..2 {
                let weight = weights[h].row(0, y);
                let from = [0, 1, 2].map(|k| from(h, k, y));
                let target = [0, 1, 2].map(|k| prepared.target_row(h, k, y));
                let to = [0, 1, 2].map(|k| to(h, k, y));
                for x in 0..width {
                    let [r, d] = [target, to].map(|of| [0, 1, 2].map(|k| of[k][x] - from[k][x]));
                    agreement[x] += weight[x] * dot(limited(r, weight[x]), d);
                    size[x] += weight[x] * dot(d, d);
                }
            }
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

/// A residual of a pixel as it counts.
pub(crate) fn limited(r: [f32; 3], weight: f32) -> [f32; 3] {
    let limit = LARGEST_RESIDUAL / (weight * dot(r, r)).sqrt().max(LARGEST_RESIDUAL);
    r.map(|r| limit * r)
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

pub(crate) fn dot(p: [f32; 3], q: [f32; 3]) -> f32 {
    p[0] * q[0] + p[1] * q[1] + p[2] * q[2]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::plan::Plan;
    use crate::prepare::Findings;
    use sspc_image::HalfWeights;
    use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet, RADIANCE};
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
}
