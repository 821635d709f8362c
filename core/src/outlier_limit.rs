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
use rayon::prelude::*;
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
/// Share with which a pixel of none is limited: its change counts that many times.
const LEAST_SHARE: f32 = 1e-3;

/// Changes a `picture` `[3, H, W]`, of which z + share (picture - z) enters, so that this lies near both halves'
/// z + share (μ̂ - z). Where nothing of the correction is used, the denoiser's picture is limited by the halves' z, by
/// the least share that carries it. Blocks that the plan leaves out stay.
pub(crate) fn limit_outliers(prepared: &Prepared, halves: &[Image; 2], share: &mut Image, picture: &mut Image) {
    let (height, width) = (share.height(), share.width());
    if height * width == 0 {
        return;
    }
    // Squared distances of the picture and of the halves from the halves' mean, and how far these are apart.
    let mut distances = Image::zeros(3, height, width);
    let [of_picture, of_halves, close] = distances.planes_mut().map(|plane| plane.par_chunks_mut(width));
    of_picture.zip(of_halves).zip(close).enumerate().for_each(|(y, ((of_picture, of_halves), close))| {
        let blended = Blended::of(prepared, halves, share, y);
        let whole = [0, 1, 2].map(|k| (prepared.denoised.row(k, y), picture.row(k, y)));
        for x in 0..width {
            let [a, b] = blended.at(x);
            let whole = whole.map(|(z, corrected)| mixed(z[x], corrected[x], blended.share[x]));
            let mean = mean(a, b);
            let weight = weight_of(mean, RELATIVE_FLOOR);
            of_picture[x] = weight * squared_distance(whole, mean);
            of_halves[x] = weight * squared_distance(a, mean);
            close[x] = (0..3).map(|k| (a[k] - b[k]).abs()).sum::<f32>() / 3.0;
        }
    });
    let plane = |c: usize| Image::from_planes(1, height, width, distances.plane(c).to_vec());
    let (of_picture, of_halves) = (box_mean(&plane(0), LIMIT_RADIUS), box_mean(&plane(1), LIMIT_RADIUS));
    let close = box_mean(&plane(2), CLOSE_RADIUS);
    let unlimited = share.clone();
    let [red, green, blue] = picture.planes_mut().map(|plane| plane.par_chunks_mut(width));
    let rows = red.zip(green).zip(blue).zip(share.plane_mut(0).par_chunks_mut(width)).enumerate();
    rows.for_each(|(y, (((red, green), blue), share))| {
        let blended = Blended::of(prepared, halves, &unlimited, y);
        let denoised = [0, 1, 2].map(|k| prepared.denoised.row(k, y));
        let (of_picture, of_halves, close) = (of_picture.row(0, y), of_halves.row(0, y), close.row(0, y));
        for x in (0..width).filter(|&x| prepared.plan.is_active(y, x)) {
            let [a, b] = blended.at(x);
            let (far, allowed) = (of_picture[x], TIMES_AROUND * of_halves[x]);
            let margin = TIMES_CLOSE * close[x];
            let z = denoised.map(|row| row[x]);
            let (kept, raised) = (share[x], share[x].max(LEAST_SHARE));
            let mut corrected = [&mut red[x], &mut green[x], &mut blue[x]];
            let whole = [0, 1, 2].map(|k| mixed(z[k], *corrected[k], kept));
            let limited = [0, 1, 2].map(|k| {
                let mean = 0.5 * (a[k] + b[k]);
                let nearer = if far > allowed { mean + allowed / far * (whole[k] - mean) } else { whole[k] };
                nearer.max(a[k].min(b[k]) - margin).min(a[k].max(b[k]) + margin)
            });
            if limited != whole {
                share[x] = raised;
                (0..3).filter(|&k| limited[k] != whole[k] || raised != kept).for_each(|k| {
                    *corrected[k] = z[k] + (limited[k] - z[k]) / raised;
                });
            }
        }
    });
}

/// A row of both halves with the share of their correction that is used.
struct Blended<'a> {
    /// z and the corrected value, of halves and channels.
    values: [[(&'a [f32], &'a [f32]); 3]; 2],
    share: &'a [f32],
}

impl<'a> Blended<'a> {
    fn of(prepared: &'a Prepared, halves: &'a [Image; 2], share: &'a Image, y: usize) -> Self {
        let row = |h: usize, k: usize| (prepared.halves[h].row(DENOISED + k, y), halves[h].row(k, y));
        Self { values: [0, 1].map(|h| [0, 1, 2].map(|k| row(h, k))), share: share.row(0, y) }
    }

    fn at(&self, x: usize) -> [[f32; 3]; 2] {
        self.values.map(|half| half.map(|(z, corrected)| mixed(z[x], corrected[x], self.share[x])))
    }
}

/// z + share (corrected - z).
fn mixed(z: f32, corrected: f32, share: f32) -> f32 {
    z + share * (corrected - z)
}

fn mean(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]))
}

fn squared_distance(p: [f32; 3], q: [f32; 3]) -> f32 {
    (0..3).map(|k| (p[k] - q[k]).powi(2)).sum()
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
        let mut share = Image::filled(1, SIZE.0, SIZE.1, share);
        let mut picture = prepared.denoised.clone();
        limit_outliers(&prepared, &halves, &mut share, &mut picture);
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

    /// Halves whose z is 1 both: nothing of the correction to 0.9 and 1.1 is used, and z holds the picture.
    #[test]
    fn where_no_correction_is_used_the_halves_denoised_pictures_limit() {
        assert!((limited(50.0, [0.9, 1.1], 0.0) - 1.0).abs() < 1e-4, "{}", limited(50.0, [0.9, 1.1], 0.0));
        assert_eq!(limited(1.0, [0.9, 1.1], 0.0), 1.0);
    }

    /// Close by nothing is out of range; over 17x17 pixels the picture is 0.3 off where the halves are 0.1.
    #[test]
    fn a_picture_that_is_off_all_around_comes_nearer() {
        let (mut prepared, size) = (with_firefly(1.0), SIZE);
        prepared.denoised = Image::filled(3, size.0, size.1, 1.3);
        let halves = [0.9, 1.1].map(|value| Image::filled(3, size.0, size.1, value));
        let mut share = Image::filled(1, size.0, size.1, 1.0);
        let mut picture = prepared.denoised.clone();
        limit_outliers(&prepared, &halves, &mut share, &mut picture);
        // 3 times 0.1² over 0.3² of the way back from the halves' mean.
        let expected = 1.0 + 3.0 * 0.01 / 0.09 * 0.3;
        assert!(picture.data().iter().all(|value| (value - expected).abs() < 1e-4), "{:?}", &picture.data()[..4]);
    }

    #[test]
    fn blocks_that_are_left_out_stay() {
        let mut prepared = with_firefly(50.0);
        prepared.plan = Plan::nothing(SIZE.0, SIZE.1);
        let halves = [0, 1].map(|_| Image::filled(3, SIZE.0, SIZE.1, 1.0));
        let (mut share, mut picture) = (Image::filled(1, SIZE.0, SIZE.1, 1.0), prepared.denoised.clone());
        limit_outliers(&prepared, &halves, &mut share, &mut picture);
        assert_eq!(picture.data(), prepared.denoised.data());
    }

    #[test]
    fn halves_that_agree_leave_no_margin() {
        assert!((limited(50.0, [1.0, 1.0], 0.5) - 1.0).abs() < 1e-5);
    }
}
