//! Whether both halves show the same things.
//!
//! Noise of independent samples has nothing to do with its neighbours'. Where the halves show different things (particle
//! hair that grows differently in every process, a simulation without a cache), their difference has the shape of these
//! things: it correlates between neighbouring pixels, in radiance and in the features. Corrected with such halves, fur
//! becomes a smear, with a better loss.
//!
//! The correlation of (y^a - y^b) / (y^a + y^b) is taken tile by tile, mean taken off, right and lower neighbours together:
//! the median of a whole picture hides a furry animal. Of 91 tiles of a pair with two furs, 14 % exceed `CORRELATED`; of
//! ten other pairs (fur, grass, depth of field, outliers, 8 to 128 samples a half), 0 to 0.3 %.
//!
//! Filters that splat samples correlate everywhere, so what counts is what exceeds the median. Different fur that fills more
//! than half of the picture is therefore not told from such a filter; the warning of correlated neighbours names both.

use rayon::prelude::*;
use sspc_image::{Frame, Image, Role};
use std::ops::Range;

/// Side of a tile, pixels.
pub const TILE: usize = 24;
/// Correlation above which a tile shows different things; above the picture's median where that is positive, since filters
/// that splat samples correlate everywhere.
const CORRELATED: f64 = 0.15;
/// The same beside such a tile.
const CORRELATED_BESIDE: f64 = 0.075;
/// Share of the tiles with noise from which a picture is said to show different things.
const LEAST_SHARE: f64 = 0.02;
/// The same of radiance where albedo or normal exceed [`LEAST_FEATURE_SHARE`].
const LEAST_SHARE_WITH_FEATURE: f64 = 0.005;
/// Noisy features of the same things reach 4 %, different ones 16 to 28 %.
const LEAST_FEATURE_SHARE: f64 = 0.1;
/// Fewest such tiles: one or two may be chance.
const LEAST_TILES: usize = 3;
/// Share of a tile's pixels that must differ between the halves for their difference to mean anything.
const LEAST_NOISE: f64 = 0.5;
/// What is compared: radiance, albedo, normal.
const KINDS: usize = 3;

/// Tiles of a picture where the halves show different things.
#[derive(Clone, Debug, PartialEq)]
pub struct DifferentPlaces {
    columns: usize,
    tiles: Vec<bool>,
    /// Share of the tiles with noise, 0..1.
    pub share: f64,
}

impl DifferentPlaces {
    /// Whether a pixel lies in such a tile.
    pub fn holds(&self, y: usize, x: usize) -> bool {
        self.tiles[y / TILE * self.columns + x / TILE]
    }

    /// What a person should know.
    pub fn warning(&self) -> String {
        format!(
            "the halves show different things in {:.0} % of the picture: those places stay the denoiser's; bake hair and simulations, or render both halves in one process",
            100.0 * self.share
        )
    }

    /// Takes these places of some rows, which begin at row `first`, out of everything: they count as missing, and keep the
    /// denoiser's values.
    pub fn take_out(&self, frame: &mut Frame, first: usize) {
        let radiance = &mut frame.a.radiance;
        radiance.for_each_row(|_, y, row| {
            for (_, value) in row.iter_mut().enumerate().filter(|(x, _)| self.holds(first + y, *x)) {
                *value = f32::NAN;
            }
        });
    }

    /// 1 in these places, 0 elsewhere, `[1, H, W]`.
    pub fn map(&self, height: usize, width: usize) -> Image {
        Image::from_fn(1, height, width, |_, y, x| f32::from(u8::from(self.holds(y, x))))
    }
}

/// Sums over a tile's pixels and pairs of neighbours, three channels.
#[derive(Clone, Copy, Default)]
struct Sums {
    pixels: u32,
    /// Pixels with any difference.
    noisy: u32,
    sum: [f64; 3],
    square: [f64; 3],
    pairs: u32,
    product: [f64; 3],
    pair_sum: [f64; 3],
}

impl Sums {
    /// Adds a tile's part of a row of differences, NaN in all channels where there is none, and of the row above it.
    fn add(&mut self, here: [&[f32]; 3], above: Option<[&[f32]; 3]>) {
        let known = |row: [&[f32]; 3]| row[0].iter().fold(true, |known, d| known & !d.is_nan());
        if known(here) && above.is_none_or(known) {
            self.add_known(here, above);
        } else {
            self.add_some(here, above);
        }
    }

    /// The same where there is a difference in every pixel.
    fn add_known(&mut self, here: [&[f32]; 3], above: Option<[&[f32]; 3]>) {
        let [red, green, blue] = here;
        let pixels = red.len();
        self.pixels += pixels as u32;
        self.pairs += (pixels - 1 + above.map_or(0, |_| pixels)) as u32;
        let colours = red.iter().zip(green).zip(blue);
        self.noisy += colours.map(|((r, g), b)| u32::from((*r != 0.0) | (*g != 0.0) | (*b != 0.0))).sum::<u32>();
        for (c, here) in here.into_iter().enumerate() {
            let (sum, square) = summed(here, here);
            self.sum[c] += 0.5 * sum;
            self.square[c] += square;
            for (d, e) in [(&here[..pixels - 1], &here[1..])].into_iter().chain(above.map(|above| (here, above[c]))) {
                let (sum, product) = summed(d, e);
                self.pair_sum[c] += sum;
                self.product[c] += product;
            }
        }
    }

    /// The same pixel by pixel.
    fn add_some(&mut self, here: [&[f32]; 3], above: Option<[&[f32]; 3]>) {
        let at = |row: [&[f32]; 3], x: usize| row.map(|row| row[x]);
        let known = |d: &[f32; 3]| !d[0].is_nan();
        for x in 0..here[0].len() {
            let d = at(here, x);
            if !known(&d) {
                continue;
            }
            self.pixels += 1;
            self.noisy += u32::from(d != [0.0; 3]);
            for (c, d) in d.into_iter().map(f64::from).enumerate() {
                self.sum[c] += d;
                self.square[c] += d * d;
            }
            let right = (x + 1 < here[0].len()).then(|| at(here, x + 1));
            for other in right.into_iter().chain(above.map(|above| at(above, x))).filter(known) {
                self.pairs += 1;
                for (c, (d, e)) in d.into_iter().zip(other).enumerate() {
                    self.product[c] += f64::from(d) * f64::from(e);
                    self.pair_sum[c] += f64::from(d) + f64::from(e);
                }
            }
        }
    }

    /// Correlation of neighbours, all channels together; `None` without noise.
    fn correlation(&self) -> Option<f64> {
        let (n, pairs) = (f64::from(self.pixels), f64::from(self.pairs));
        let enough = self.pixels as usize >= TILE * TILE / 2 && f64::from(self.noisy) >= LEAST_NOISE * n;
        let (mut covariance, mut variance) = (0.0, 0.0);
        for c in 0..3 {
            let mean = self.sum[c] / n;
            variance += self.square[c] / n - mean * mean;
            covariance += (self.product[c] - mean * self.pair_sum[c]) / pairs + mean * mean;
        }
        // Rounding of equal values is no noise.
        (enough && pairs > 0.0 && variance > 1e-12).then(|| covariance / variance)
    }
}

/// Σ (d + e) and Σ d e, in four sums each, which do not wait for one another.
fn summed(d: &[f32], e: &[f32]) -> (f64, f64) {
    let (mut sums, mut products) = ([0.0; 4], [0.0; 4]);
    let ((d, last_d), (e, last_e)) = (d.as_chunks::<4>(), e.as_chunks::<4>());
    for (d, e) in d.iter().zip(e) {
        for i in 0..4 {
            let (d, e) = (f64::from(d[i]), f64::from(e[i]));
            sums[i] += d + e;
            products[i] += d * e;
        }
    }
    for (d, e) in last_d.iter().zip(last_e) {
        sums[0] += f64::from(*d) + f64::from(*e);
        products[0] += f64::from(*d) * f64::from(*e);
    }
    let all = |sums: [f64; 4]| (sums[0] + sums[1]) + (sums[2] + sums[3]);
    (all(sums), all(products))
}

/// Compares the halves of a frame that comes in bands from top to bottom, each row once.
pub struct SceneComparison {
    width: usize,
    columns: usize,
    rows: usize,
    sums: [Vec<Sums>; KINDS],
    /// Differences of the row above, of each kind.
    above: [Differences; KINDS],
}

impl SceneComparison {
    /// Of a picture of this size, of which nothing was seen yet.
    pub fn new(height: usize, width: usize) -> Self {
        let columns = width.div_ceil(TILE);
        let tiles = columns * height.div_ceil(TILE);
        Self {
            width,
            columns,
            rows: 0,
            sums: std::array::from_fn(|_| vec![Sums::default(); tiles]),
            above: std::array::from_fn(|_| Differences::none(width)),
        }
    }

    /// Looks at the next rows below.
    pub fn look(&mut self, band: &Frame) {
        let pair = |role| band.a.feature(role).zip(band.b.feature(role));
        let images = [Some((&band.a.radiance, &band.b.radiance)), pair(Role::Albedo), pair(Role::Normal)];
        let (first, last, width, columns) = (self.rows, self.rows + band.height(), self.width, self.columns);
        if band.height() * width == 0 {
            return;
        }
        let compared = self.sums.par_iter_mut().zip(self.above.par_iter_mut()).zip(images).enumerate();
        compared.for_each(|(kind, ((sums, above), images))| {
            let Some(images) = images else { return };
            let of_row = |row: usize, differences: &mut Differences| differences.read(images, row - first, kind == 0);
            // Tiles share nothing with those above them.
            let tiles = sums[first / TILE * columns..last.div_ceil(TILE) * columns].par_chunks_mut(columns);
            tiles.enumerate().for_each(|(at, sums)| {
                let top = (first / TILE + at) * TILE;
                let (mut here, mut before) = (Differences::none(width), above.clone());
                for row in top.max(first)..(top + TILE).min(last) {
                    of_row(row, &mut here);
                    for (sums, x) in sums.iter_mut().zip((0..width).step_by(TILE)) {
                        let columns = x..(x + TILE).min(width);
                        sums.add(here.at(&columns), (row > top).then(|| before.at(&columns)));
                    }
                    std::mem::swap(&mut here, &mut before);
                }
            });
            of_row(last - 1, above);
        });
        self.rows = last;
    }

    /// Where the halves show different things, if they do.
    pub fn finish(&self) -> Option<DifferentPlaces> {
        let [radiance, albedo, normal] =
            self.sums.each_ref().map(|sums| sums.iter().map(Sums::correlation).collect::<Vec<_>>());
        let mut noisy: Vec<f64> = radiance.iter().flatten().copied().collect();
        noisy.sort_by(f64::total_cmp);
        let median = noisy.get(noisy.len() / 2)?.max(0.0);
        let exceeds = |tile: &Option<f64>, limit: f64| tile.is_some_and(|r| r > limit);
        let count = |tiles: &[Option<f64>]| tiles.iter().filter(|tile| exceeds(tile, CORRELATED)).count();
        let of_features = |tiles: &[Option<f64>]| {
            count(tiles) as f64 >= LEAST_FEATURE_SHARE * tiles.iter().flatten().count().max(LEAST_TILES) as f64
        };
        let is_core = |tile: &Option<f64>| exceeds(tile, CORRELATED + median);
        let cores = radiance.iter().filter(|tile| is_core(tile)).count();
        let share = cores as f64 / noisy.len() as f64;
        let least = if of_features(&albedo) || of_features(&normal) { LEAST_SHARE_WITH_FEATURE } else { LEAST_SHARE };
        if cores < LEAST_TILES || share < least {
            return None;
        }
        let around = |tile: usize| {
            let (y, x) = (tile / self.columns, tile % self.columns);
            let rows = y.saturating_sub(1)..(y + 2).min(radiance.len() / self.columns);
            let columns = x.saturating_sub(1)..(x + 2).min(self.columns);
            rows.flat_map(move |y| columns.clone().map(move |x| y * self.columns + x))
        };
        let belongs = |tile: usize| {
            let beside = exceeds(&radiance[tile], CORRELATED_BESIDE + median);
            beside || [&albedo, &normal].iter().any(|feature| exceeds(&feature[tile], CORRELATED))
        };
        // From sure tiles on to those beside them: the dark side of an animal is furry too.
        let mut tiles: Vec<bool> = radiance.iter().map(is_core).collect();
        let mut due: Vec<usize> = (0..tiles.len()).filter(|&tile| tiles[tile]).collect();
        while let Some(tile) = due.pop() {
            for other in around(tile).filter(|&other| belongs(other)) {
                if !std::mem::replace(&mut tiles[other], true) {
                    due.push(other);
                }
            }
        }
        let share = tiles.iter().filter(|different| **different).count() as f64 / tiles.len() as f64;
        Some(DifferentPlaces { columns: self.columns, tiles, share })
    }
}

/// Differences of the halves in a row, by channel; NaN in all of them where one is not finite.
#[derive(Clone)]
struct Differences([Vec<f32>; 3]);

impl Differences {
    fn none(width: usize) -> Self {
        Self(std::array::from_fn(|_| vec![f32::NAN; width]))
    }

    fn at(&self, columns: &Range<usize>) -> [&[f32]; 3] {
        self.0.each_ref().map(|row| &row[columns.clone()])
    }

    /// Those of row `y`: of features as they are, of radiance by the sum, so that no brightness counts more.
    fn read(&mut self, (a, b): (&Image, &Image), y: usize, by_sum: bool) {
        for (c, differences) in self.0.iter_mut().enumerate() {
            let c = c.min(a.channels() - 1);
            for ((d, a), b) in differences.iter_mut().zip(a.row(c, y)).zip(b.row(c, y)) {
                let (p, q) = (a.max(0.0), b.max(0.0));
                let relative = if p + q > 0.0 { (p - q) / (p + q) } else { 0.0 };
                let of_both = if by_sum { relative } else { a - b };
                // NaN of an infinite difference, and of infinite values.
                *d = of_both + 0.0 * (a - b);
            }
        }
        let [red, green, blue] = &mut self.0;
        for ((r, g), b) in red.iter_mut().zip(green).zip(blue) {
            if (*r + *g + *b).is_nan() {
                (*r, *g, *b) = (f32::NAN, f32::NAN, f32::NAN);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;
    use sspc_image::HalfBuffer;

    const SIDE: usize = 144;

    /// Halves of a picture `shown(half, y, x)` with noise of its own size, filtered by `filter`.
    fn frame(seed: u64, shown: impl Fn(usize, usize, usize) -> f32, splat: bool) -> Frame {
        let mut rng = Rng::new(seed);
        let half = |h: usize, rng: &mut Rng| {
            let raw = Image::from_fn(3, SIDE, SIDE, |_, y, x| shown(h, y, x) * (0.4 + 1.2 * rng.uniform()));
            let at = |c, y: usize, x: usize| raw.at(c, y.min(SIDE - 1), x.min(SIDE - 1));
            let filtered = |c, y, x| (at(c, y, x) + at(c, y + 1, x) + at(c, y, x + 1) + at(c, y + 1, x + 1)) / 4.0;
            let radiance = if splat { Image::from_fn(3, SIDE, SIDE, filtered) } else { raw };
            HalfBuffer { denoised: radiance.clone(), radiance, albedo: None, normal: None, visibility: None }
        };
        let (a, b) = (half(0, &mut rng), half(1, &mut rng));
        Frame::of_halves(a, b)
    }

    fn places(frame: &Frame) -> Option<DifferentPlaces> {
        let mut comparison = SceneComparison::new(SIDE, SIDE);
        comparison.look(frame);
        comparison.finish()
    }

    /// Strands four pixels wide, other ones for every seed.
    fn strands(seed: usize, y: usize, x: usize) -> f32 {
        let hash = (x / 4 + 31 * (y / 9) + 977 * seed).wrapping_mul(0x9E37_79B9) >> 7;
        0.1 + (hash % 64) as f32 / 64.0
    }

    #[test]
    fn two_furs_are_found_where_they_are() {
        let furry = |y: usize, x: usize| y < 72 && x < 72;
        let shown = |h: usize, y: usize, x: usize| if furry(y, x) { strands(h, y, x) } else { 0.5 };
        let found = places(&frame(1, shown, false)).expect("two furs");
        assert!(found.holds(10, 10) && found.holds(60, 60) && !found.holds(130, 130), "{found:?}");
        assert!((0.15..0.5).contains(&found.share), "{}", found.share);
    }

    #[test]
    fn one_fur_noise_fireflies_and_filters_are_not() {
        let same = |_: usize, y: usize, x: usize| strands(0, y, x);
        assert_eq!(places(&frame(2, same, false)), None, "the same fur");
        assert_eq!(places(&frame(3, same, true)), None, "a filter that splats");
        let dark = |_: usize, y: usize, x: usize| if (y / 40 + x / 40).is_multiple_of(2) { 0.0 } else { 1e-6 };
        assert_eq!(places(&frame(4, dark, false)), None, "black and nearly black");
        let mut fireflies = frame(5, same, false);
        let mut rng = Rng::new(6);
        for _ in 0..400 {
            let (y, x) = (rng.below(SIDE), rng.below(SIDE));
            (0..3).for_each(|c| fireflies.a.radiance.set(c, y, x, 1e4));
        }
        assert_eq!(places(&fireflies), None, "fireflies");
    }

    /// One pixel at a time. NaN in any channel is no difference; rows of any length, on top of a tile or not.
    #[test]
    fn sums_of_rows_are_those_of_their_pixels() {
        let rng = &mut Rng::new(9);
        for (width, with_missing, is_top) in
            [(1, false, true), (7, false, false), (24, false, false), (24, true, false)]
        {
            let mut row = || -> [Vec<f32>; 3] { [(); 3].map(|()| (0..width).map(|_| rng.normal()).collect()) };
            let (mut here, above) = (row(), row());
            here[1][0] = 0.0;
            if with_missing {
                here.iter_mut().for_each(|row| row[3] = f32::NAN);
            }
            let slices = [&here, &above].map(|rows| rows.each_ref().map(|row| &row[..]));
            let above_there = (!is_top).then_some(slices[1]);
            let (mut found, mut expected) = (Sums::default(), Sums::default());
            found.add(slices[0], above_there);
            expected.add_some(slices[0], above_there);
            assert_eq!((found.pixels, found.noisy, found.pairs), (expected.pixels, expected.noisy, expected.pairs));
            assert_eq!(found.pixels as usize, width - usize::from(with_missing));
            for of in [
                |sums: &Sums| sums.sum,
                |sums: &Sums| sums.square,
                |sums: &Sums| sums.product,
                |sums: &Sums| sums.pair_sum,
            ] {
                let pairs = of(&found).into_iter().zip(of(&expected));
                assert!(pairs.into_iter().all(|(found, expected)| (found - expected).abs() < 1e-12), "{width}");
            }
        }
    }

    #[test]
    fn bands_give_what_the_whole_gives() {
        let frame = frame(7, |h, y, x| strands(h * usize::from(x < 100), y, x), false);
        let mut comparison = SceneComparison::new(SIDE, SIDE);
        for rows in [0..7, 7..64, 64..65, 65..SIDE] {
            comparison.look(&frame.rows(rows.start, rows.len()));
        }
        assert_eq!(comparison.finish(), places(&frame));
    }

    #[test]
    fn what_is_taken_out_is_missing_and_nothing_else() {
        let mut frame = frame(8, |h, y, x| if x < 60 { strands(h, y, x) } else { 0.5 }, false);
        let found = places(&frame).expect("two furs");
        let before = frame.clone();
        found.take_out(&mut frame, 0);
        for y in 0..SIDE {
            for x in 0..SIDE {
                let (now, then) = (frame.a.radiance.at(1, y, x), before.a.radiance.at(1, y, x));
                assert!(if found.holds(y, x) { now.is_nan() } else { now == then }, "({y}, {x})");
            }
        }
        assert_eq!(frame.b.radiance, before.b.radiance);
    }
}
