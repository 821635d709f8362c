//! Keeps the picture near what both corrected halves say.
//!
//! The denoiser's picture of the full buffer is less noisy than those of the halves, and so is its correction; but a
//! firefly that it takes for a detail stays in it whole, where the halves agree on something else. Two halves with errors
//! of one size and independent signs differ by about as much as their mean differs from the picture. So where the picture
//! is further from the mean than that, around a pixel, it is brought nearer; and no pixel leaves the halves' range by more
//! than twice what they differ by close to it. Where one half itself is far brighter than the other and nothing around
//! the pixel differs so, the brighter one is the firefly, and the range is from the darker to a little above it.

use crate::lanes::{LANES, lanes, lanes_of_colour, less, mixed, put, squared, widest};
use crate::objective::{RELATIVE_FLOOR, weight_of};
use crate::plan::Plan;
use crate::prepare::Prepared;
use rayon::prelude::*;
use sspc_image::{HalfWeights, Image, box_mean};
use sspc_kernels::features::DENOISED;
use sspc_kernels::simd::{Kernel, Simd};

/// Radius of the box in which squared distances are averaged, pixels: what a pixel's limit depends on.
pub const LIMIT_RADIUS: usize = 8;
/// How many times the halves' mean squared distance from their mean the picture's may be.
pub const TIMES_AROUND: f32 = 3.0;
/// Radius of the box in which the halves' difference is averaged for a pixel's own limit.
pub const CLOSE_RADIUS: usize = 2;
/// How many times that difference a pixel may leave the halves' range by.
pub const TIMES_CLOSE: f32 = 2.0;
/// Radii of the ring around a pixel in which the halves' difference is averaged, to tell an outlier of one half: more than
/// the first and up to the second.
pub const RING: (usize, usize) = (1, 4);
/// How many times that difference the halves of a pixel may lie apart. (Of 13 frames 0.01 to 0.06 % of the pixels lie
/// further; the fur loses 0.4 % of its light by that and a quarter of its error, others 0.1 % and up to 2 %.)
pub const TIMES_APART: f32 = 16.0;
/// Least difference in a ring, in the method's units.
pub const LEAST_APART: f32 = 2.5e-4;
/// Share with which a pixel of none is limited: its change counts that many times.
pub const LEAST_SHARE: f32 = 1e-3;

/// Changes a `picture` `[3, H, W]`, of which z + share (picture - z) enters, so that this lies near both halves'
/// z + share (μ̂ - z). Where nothing of the correction is used, the denoiser's picture is limited by the halves' z, by
/// the least share that carries it. Blocks that the plan leaves out stay.
pub(crate) fn limit_outliers(prepared: &Prepared, halves: &[Image; 2], share: &mut Image, picture: &mut Image) {
    let (height, width) = (share.height(), share.width());
    if height * width == 0 {
        return;
    }
    // Squared distances of the picture and of the halves from the halves' mean, and how far these are apart.
    let [mut of_picture, mut of_halves, mut apart] = [(); 3].map(|()| Image::zeros(1, height, width));
    // ‖a - m‖² is w_b² ‖a - b‖², and the squared error of the mean m is expected to be w_a w_b ‖a - b‖².
    let of_mean = prepared.weights.of(0) / prepared.weights.of(1);
    let planes = [&mut of_picture, &mut of_halves, &mut apart].map(|image| image.plane_mut(0).par_chunks_mut(width));
    let [of_picture_rows, of_halves_rows, apart_rows] = planes;
    of_picture_rows.zip(of_halves_rows).zip(apart_rows).enumerate().for_each(
        |(y, ((of_picture, of_halves), apart))| {
            let rows = Rows::new(prepared, halves, y);
            let (picture, share) = ([0, 1, 2].map(|k| picture.row(k, y)), share.row(0, y));
            widest(Distances { rows, picture, share, of_mean, of_picture, of_halves, apart });
        },
    );
    let (of_picture, of_halves) = (box_mean(&of_picture, LIMIT_RADIUS), box_mean(&of_halves, LIMIT_RADIUS));
    let (close, around) = (box_mean(&apart, CLOSE_RADIUS), ring_mean(&apart));
    let [red, green, blue] = picture.planes_mut().map(|plane| plane.par_chunks_mut(width));
    let rows = red.zip(green).zip(blue).zip(share.plane_mut(0).par_chunks_mut(width)).enumerate();
    rows.for_each(|(y, (((red, green), blue), share))| {
        let limits = [&of_picture, &of_halves, &close, &apart, &around].map(|image| image.row(0, y));
        let (rows, plan) = (Rows::new(prepared, halves, y), &prepared.plan);
        widest(Limit { y, rows, plan, limits, picture: [red, green, blue], share });
    });
}

/// Squared distances of a row of the picture and of half a from the halves' mean, and how far the halves are apart.
struct Distances<'a> {
    rows: Rows<'a>,
    picture: [&'a [f32]; 3],
    share: &'a [f32],
    /// What makes the expected squared error of the mean of a half's squared distance.
    of_mean: f32,
    of_picture: &'a mut [f32],
    of_halves: &'a mut [f32],
    apart: &'a mut [f32],
}

impl Kernel for Distances<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        for x in (0..self.share.len()).step_by(LANES) {
            let Blended { a, b, whole, mean } = self.rows.blended(&self.picture, self.share, x);
            let (mut far, mut own) = (distance(&whole, &mean), distance(&a, &mean));
            let mut apart = [0.0; LANES];
            for i in 0..LANES {
                let weight = weight_of([mean[0][i], mean[1][i], mean[2][i]], RELATIVE_FLOOR);
                far[i] *= weight;
                own[i] = weight * own[i] * self.of_mean;
                let sum = (a[0][i] - b[0][i]).abs() + (a[1][i] - b[1][i]).abs() + (a[2][i] - b[2][i]).abs();
                apart[i] = sum / 3.0;
            }
            put(self.of_picture, x, &far);
            put(self.of_halves, x, &own);
            put(self.apart, x, &apart);
        }
    }
}

/// ‖p - q‖² by pixel.
#[inline(always)]
fn distance(p: &[[f32; LANES]; 3], q: &[[f32; LANES]; 3]) -> [f32; LANES] {
    squared(&[less(&p[0], &q[0]), less(&p[1], &q[1]), less(&p[2], &q[2])])
}

/// Limits a row of the picture.
struct Limit<'a> {
    y: usize,
    rows: Rows<'a>,
    plan: &'a Plan,
    /// As of [`Blended::limited`].
    limits: [&'a [f32]; 5],
    picture: [&'a mut [f32]; 3],
    share: &'a mut [f32],
}

impl Kernel for Limit<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self { y, rows, plan, limits: [far, own, close, apart, around], picture: [red, green, blue], share } = self;
        let width = share.len();
        for x in (0..width).step_by(LANES) {
            if !plan.is_active(y, x) {
                continue;
            }
            let blended = rows.blended(&[&*red, &*green, &*blue], share, x);
            let limits = [lanes(far, x), lanes(own, x), lanes(close, x), lanes(apart, x), lanes(around, x)];
            let limited = blended.limited(&limits);
            let mut is_limited = [false; LANES];
            for (limited, whole) in limited.iter().zip(&blended.whole) {
                for i in 0..LANES {
                    is_limited[i] |= limited[i] != whole[i];
                }
            }
            for i in 0..LANES.min(width - x) {
                if is_limited[i] {
                    let share = &mut share[x + i];
                    *share = share.max(LEAST_SHARE);
                    let z = rows.denoised;
                    red[x + i] = z[0][x + i] + (limited[0][i] - z[0][x + i]) / *share;
                    green[x + i] = z[1][x + i] + (limited[1][i] - z[1][x + i]) / *share;
                    blue[x + i] = z[2][x + i] + (limited[2][i] - z[2][x + i]) / *share;
                }
            }
        }
    }
}

/// Mean of a plane over the ring around each pixel; at the border as if it were whole.
fn ring_mean(plane: &Image) -> Image {
    let (inner, outer) = RING;
    let pixels = |radius: usize| ((2 * radius + 1) * (2 * radius + 1)) as f32;
    let (hole, mut ring) = (box_mean(plane, inner), box_mean(plane, outer));
    ring.for_each_row(|_, y, row| {
        for (mean, hole) in row.iter_mut().zip(hole.row(0, y)) {
            *mean = ((*mean * pixels(outer) - hole * pixels(inner)) / (pixels(outer) - pixels(inner))).max(0.0);
        }
    });
    ring
}

/// A row of both halves, corrected and denoised, and of the denoised full buffer, by channel.
struct Rows<'a> {
    z: [[&'a [f32]; 3]; 2],
    corrected: [[&'a [f32]; 3]; 2],
    denoised: [&'a [f32]; 3],
    weights: HalfWeights,
}

/// Some pixels of both halves and of the picture with their share of the correction, and of the halves' mean, by channel.
struct Blended {
    a: [[f32; LANES]; 3],
    b: [[f32; LANES]; 3],
    whole: [[f32; LANES]; 3],
    mean: [[f32; LANES]; 3],
}

impl<'a> Rows<'a> {
    fn new(prepared: &'a Prepared, halves: &'a [Image; 2], y: usize) -> Self {
        let channels = |image: &'a Image, first: usize| [0, 1, 2].map(|k| image.row(first + k, y));
        Self {
            z: [0, 1].map(|h| channels(&prepared.halves[h], DENOISED)),
            corrected: [0, 1].map(|h| channels(&halves[h], 0)),
            denoised: channels(&prepared.denoised, 0),
            weights: prepared.weights,
        }
    }

    /// The pixels from column `x` on, of a row of a corrected picture and of the share that is used.
    #[inline(always)]
    fn blended(&self, picture: &[&[f32]; 3], share: &[f32], x: usize) -> Blended {
        let share = lanes(share, x);
        let a = mixed_colour(&self.z[0], &self.corrected[0], &share, x);
        let b = mixed_colour(&self.z[1], &self.corrected[1], &share, x);
        let mut mean = [[0.0; LANES]; 3];
        for k in 0..3 {
            for i in 0..LANES {
                mean[k][i] = self.weights.mean(a[k][i], b[k][i]);
            }
        }
        Blended { a, b, whole: mixed_colour(&self.denoised, picture, &share, x), mean }
    }
}

/// p + share (q - p) of the pixels from column `x` on.
#[inline(always)]
fn mixed_colour(p: &[&[f32]; 3], q: &[&[f32]; 3], share: &[f32; LANES], x: usize) -> [[f32; LANES]; 3] {
    let (p, q) = (lanes_of_colour(p, x), lanes_of_colour(q, x));
    [mixed(&p[0], &q[0], share), mixed(&p[1], &q[1], share), mixed(&p[2], &q[2], share)]
}

impl Blended {
    /// The picture as far as it may be from the halves, by the means of what each is apart: of the picture's squared distance and of
    /// the halves' around, of the halves' close by, of theirs in the pixel, and in the ring around it.
    #[inline(always)]
    fn limited(&self, limits: &[[f32; LANES]; 5]) -> [[f32; LANES]; 3] {
        let [of_picture, of_halves, close, apart, around] = limits;
        let mut limited = self.whole;
        for (k, limited) in limited.iter_mut().enumerate() {
            for i in 0..LANES {
                let (far, allowed) = (of_picture[i], TIMES_AROUND * of_halves[i]);
                let margin = TIMES_CLOSE * close[i];
                let most_apart = TIMES_APART * around[i].max(LEAST_APART);
                let (a, b, value, mean) = (self.a[k][i], self.b[k][i], self.whole[k][i], self.mean[k][i]);
                let nearer = if far > allowed { mean + allowed / far * (value - mean) } else { value };
                let (darker, brighter) = (a.min(b), a.max(b));
                let is_apart = apart[i] > most_apart;
                let least = if is_apart { darker } else { darker - margin };
                let most = if is_apart { darker + most_apart } else { brighter + margin };
                limited[i] = nearer.max(least).min(most);
            }
        }
        limited
    }
}

#[cfg(test)]
mod tests {
    use super::*;
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
            composite: None,
            plan: Plan::everything(SIZE.0, SIZE.1),
            weights: HalfWeights::EQUAL,
            differences: None,
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

    /// Half b has a firefly of 5 where a says 0.5, the full buffer 3; around it they are 0.01 apart.
    #[test]
    fn a_firefly_of_one_half_comes_down_to_the_other() {
        let prepared = with_firefly(3.0);
        let mut halves = [0.5, 0.51].map(|value| Image::filled(3, SIZE.0, SIZE.1, value));
        halves[1].set(0, 6, 7, 5.0);
        let mut share = Image::filled(1, SIZE.0, SIZE.1, 1.0);
        let mut picture = prepared.denoised.clone();
        limit_outliers(&prepared, &halves, &mut share, &mut picture);
        let found = picture.at(0, 6, 7);
        assert!((0.5..=0.7).contains(&found), "{found}");
        // Where differences like that lie all around, it is no outlier.
        let spread = |y: usize, x: usize| if (y * 14 + x).is_multiple_of(3) { 5.0 } else { 0.5 };
        halves[1] = Image::from_fn(3, SIZE.0, SIZE.1, |_, y, x| spread(y, x));
        let mut picture = prepared.denoised.clone();
        limit_outliers(&prepared, &halves, &mut share, &mut picture);
        assert!(picture.at(0, 6, 7) > 1.0, "{}", picture.at(0, 6, 7));
    }

    /// Pixel by pixel, in runs of vectors and beyond them, with blocks that are left out: the same bits.
    #[test]
    fn runs_of_pixels_are_limited_as_one_pixel_is() {
        let rng = &mut crate::rng::Rng::new(23);
        let (mut pixels, mut limited_pixels) = (0, 0);
        for (height, width) in [(9, 1), (11, 16), (20, 33)] {
            let mut noise = |channels| Image::from_fn(channels, height, width, |_, _, _| (1.5 * rng.normal()).exp());
            let mut prepared = with_firefly(1.0);
            prepared.halves = [(); 2].map(|()| Arc::new(noise(FEATURE_CHANNELS)));
            prepared.denoised = noise(3);
            prepared.weights = HalfWeights::of_samples([3.0, 1.0]);
            let halves = [noise(3), noise(3)];
            let still = |y: usize, x: usize| y < 8 && x >= 16;
            let features = [0, 1].map(|h| {
                let value = |c, y, x| if still(y, x) { 1.0 } else { prepared.halves[h].at(c, y, x) };
                Image::from_fn(FEATURE_CHANNELS, height, width, value)
            });
            prepared.plan = Plan::new(&features, None);
            let (share, picture) = (Image::from_fn(1, height, width, |_, y, x| ((y + x) % 3) as f32 / 2.0), noise(3));
            let (mut found_share, mut found) = (share.clone(), picture.clone());
            limit_outliers(&prepared, &halves, &mut found_share, &mut found);
            let mix = |z: f32, corrected: f32, y, x| z + share.at(0, y, x) * (corrected - z);
            let half = |h: usize, k, y, x| mix(prepared.halves[h].at(DENOISED + k, y, x), halves[h].at(k, y, x), y, x);
            let whole = |k, y, x| mix(prepared.denoised.at(k, y, x), picture.at(k, y, x), y, x);
            let mean = |k, y, x| prepared.weights.mean(half(0, k, y, x), half(1, k, y, x));
            let distance = |y, x, of: &dyn Fn(usize) -> f32| {
                let [r, g, b] = [0, 1, 2].map(|k| (of(k) - mean(k, y, x)).powi(2));
                r + g + b
            };
            let weight = |y, x| weight_of([0, 1, 2].map(|k| mean(k, y, x)), RELATIVE_FLOOR);
            let of_picture =
                Image::from_fn(1, height, width, |_, y, x| weight(y, x) * distance(y, x, &|k| whole(k, y, x)));
            let of_halves =
                Image::from_fn(1, height, width, |_, y, x| weight(y, x) * distance(y, x, &|k| half(0, k, y, x)) * 3.0);
            let apart = Image::from_fn(1, height, width, |_, y, x| {
                let [r, g, b] = [0, 1, 2].map(|k| (half(0, k, y, x) - half(1, k, y, x)).abs());
                (r + g + b) / 3.0
            });
            let [of_picture, of_halves] = [of_picture, of_halves].map(|image| box_mean(&image, LIMIT_RADIUS));
            let (close, around) = (box_mean(&apart, CLOSE_RADIUS), ring_mean(&apart));
            for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
                let (far, allowed) = (of_picture.at(0, y, x), TIMES_AROUND * of_halves.at(0, y, x));
                let (margin, most) =
                    (TIMES_CLOSE * close.at(0, y, x), TIMES_APART * around.at(0, y, x).max(LEAST_APART));
                let limited = [0, 1, 2].map(|k| {
                    let (a, b, value) = (half(0, k, y, x), half(1, k, y, x), whole(k, y, x));
                    let nearer =
                        if far > allowed { mean(k, y, x) + allowed / far * (value - mean(k, y, x)) } else { value };
                    let is_apart = apart.at(0, y, x) > most;
                    let least = if is_apart { a.min(b) } else { a.min(b) - margin };
                    nearer.max(least).min(if is_apart { a.min(b) + most } else { a.max(b) + margin })
                });
                let changes = prepared.plan.is_active(y, x) && (0..3).any(|k| limited[k] != whole(k, y, x));
                (pixels, limited_pixels) = (pixels + 1, limited_pixels + usize::from(changes));
                let expected_share = if changes { share.at(0, y, x).max(LEAST_SHARE) } else { share.at(0, y, x) };
                assert_eq!(found_share.at(0, y, x), expected_share, "({y}, {x}) of {height}x{width}");
                for (k, limited) in limited.into_iter().enumerate() {
                    let z = prepared.denoised.at(k, y, x);
                    let expected = if changes { z + (limited - z) / expected_share } else { picture.at(k, y, x) };
                    assert_eq!(found.at(k, y, x), expected, "({y}, {x}) of {height}x{width}");
                }
            }
        }
        assert!(limited_pixels > 0 && limited_pixels < pixels, "{limited_pixels} of {pixels}");
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
