//! Several networks: the mean of their corrections, and where that is judged worse, that of the first alone.
//!
//! Errors of networks that start from different denoised pictures are less alike than their corrections, so the mean is
//! better nearly everywhere; but a denoised picture can be of no use at all. The first network's is that of the picture
//! itself, and with it a frame is corrected as if there were no others. Which is better is judged as in
//! [`crate::blend_weight`]: a correction d with the share s takes 2 s Σ w r·d - s² Σ w d² of the error away.

use crate::blend_weight::{around, best_share};
use crate::prepare::Prepared;
use crate::residuals::{Residual, Residuals, dot};
use rayon::prelude::*;
use sspc_image::Image;

/// The mean counts whole where it takes away this part of what the first correction does, or more, and not at all at the
/// first of both: half of what a good mean gains is noise of the judgement.
pub const MEAN_COUNTS: (f32, f32) = (0.8, 0.95);

/// What is used of the mean, and of the correction that is made of both.
#[derive(Clone)]
pub(crate) struct Choice {
    /// Weight of the mean, 0..1; the first has the rest.
    pub mean: Image,
    /// Share of the correction that is kept, 0..1.
    pub share: Image,
}

/// Chooses between corrected halves `[3, H, W]` of the first network and the mean of all.
pub(crate) fn choose(prepared: &Prepared, first: &[Image; 2], mean: &[Image; 2]) -> Choice {
    let [of_first, of_mean, first_size, mean_size, both] = sums(prepared, first, mean).map(around);
    let (height, width) = (prepared.height(), prepared.width());
    let weight = Image::from_rows(1, height, width, |_, y, row| {
        let [of_first, of_mean, first_size, mean_size] =
            [&of_first, &of_mean, &first_size, &mean_size].map(|image| image.row(0, y));
        for (x, t) in row.iter_mut().enumerate() {
            *t = weight_of_mean(gain(of_mean[x], mean_size[x]), gain(of_first[x], first_size[x]));
        }
    });
    let share = Image::from_rows(1, height, width, |_, y, row| {
        let [of_first, of_mean, first_size, mean_size, both, weight] =
            [&of_first, &of_mean, &first_size, &mean_size, &both, &weight].map(|image| image.row(0, y));
        for (x, share) in row.iter_mut().enumerate() {
            let t = weight[x];
            let agreement = of_first[x] + t * (of_mean[x] - of_first[x]);
            let size = (1.0 - t) * ((1.0 - t) * first_size[x] + 2.0 * t * both[x]) + t * t * mean_size[x];
            *share = best_share(agreement, size);
        }
    });
    Choice { mean: weight, share }
}

/// Weighted sums over both halves and all channels, per pixel: r·d of the first and of the mean, d² of both, and their
/// product.
fn sums(prepared: &Prepared, first: &[Image; 2], mean: &[Image; 2]) -> [Image; 5] {
    let (height, width) = (prepared.height(), prepared.width());
    let residuals = Residuals::new(prepared);
    let mut sums = Image::zeros(5, height, width);
    let mut planes = sums.all_planes_mut().map(|plane| plane.par_chunks_mut(width.max(1)));
    let [a, b, c, d, e] = std::array::from_fn(|_| planes.next().expect("five planes"));
    a.zip(b).zip(c).zip(d).zip(e).enumerate().for_each(
        |(y, ((((of_first, of_mean), first_size), mean_size), both))| {
            residuals.of_row(y, [first, mean], |Residual { x, weight, r, d: [p, q], .. }| {
                of_first[x] += weight * dot(r, p);
                of_mean[x] += weight * dot(r, q);
                first_size[x] += weight * dot(p, p);
                mean_size[x] += weight * dot(q, q);
                both[x] += weight * dot(p, q);
            });
        },
    );
    [0, 1, 2, 3, 4].map(|c| Image::from_planes(1, height, width, sums.plane(c).to_vec()))
}

/// The part of the error that a correction takes away with its best share.
fn gain(agreement: f32, size: f32) -> f32 {
    let share = best_share(agreement, size);
    share * (2.0 * agreement - share * size)
}

fn weight_of_mean(mean: f32, first: f32) -> f32 {
    let (none, whole) = MEAN_COUNTS;
    if mean >= whole * first { 1.0 } else { ((mean / first - none) / (whole - none)).clamp(0.0, 1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::blend_weight::Evidence;
    use crate::blend_weight::tests::{TRUTH, Z, without_noise};

    /// Halves without noise, of which corrections go so far towards the truth: the first's and the mean's.
    fn chosen(first: f32, mean: f32) -> (f32, f32) {
        let prepared = without_noise(3, 5);
        let corrected = |far: f32| [0, 1].map(|_| Image::filled(3, 3, 5, Z + far * (TRUTH - Z)));
        let choice = choose(&prepared, &corrected(first), &corrected(mean));
        if choice.mean.at(0, 1, 2) == 1.0 {
            let alone = Evidence::of(&prepared, &corrected(mean)).share();
            assert!((choice.share.at(0, 1, 2) - alone.at(0, 1, 2)).abs() < 1e-6);
        }
        (choice.mean.at(0, 1, 2), choice.share.at(0, 1, 2))
    }

    #[test]
    fn a_mean_that_helps_less_gives_way_to_the_first() {
        assert_eq!(chosen(0.5, 0.8), (1.0, 1.0), "the mean is nearer");
        assert_eq!(chosen(0.5, 0.5), (1.0, 1.0), "both alike");
        assert_eq!(chosen(1.0, -1.0), (0.0, 1.0), "the mean leads away");
        assert_eq!(chosen(-1.0, 0.5), (1.0, 1.0), "the first leads away");
        assert_eq!(chosen(0.0, 0.0), (1.0, 0.0), "nothing is corrected");
        let (weight, share) = chosen(0.9, 0.64);
        assert!(weight > 0.1 && weight < 0.9 && share == 1.0, "between both: {weight}, {share}");
    }
}
