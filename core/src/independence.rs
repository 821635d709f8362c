//! Whether the noise of the halves is independent, as everything that a frame says of its own error takes for granted.
//!
//! With r = y - z of a half's own z, the correlation of r^a and r^b over a block of [`BLOCK`] x [`BLOCK`] pixels is that
//! of the noise, and more where the denoiser blurred texture that both halves share. `shared_noise` tells them apart and
//! gives the frame's correlation. Texture of all frequencies that no feature shows is left, as of fine leaves. But noise
//! that is shared is shared everywhere: where the **lowest twentieth** of the blocks lies far below their **lower
//! quartile**, such texture is at work, and the correlation can't be larger than that twentieth and what chance takes
//! off it.
//!
//! The other measures tell halves that are not of one picture: brightness of the denoised halves, energy of the
//! residuals, and whether albedo and normal have their edges in the same places (`alignment`).

use crate::alignment::Alignment;
use crate::block_sample::BlockSample;
use crate::estimate::BLOCK;
use crate::shared_noise::SharedNoise;
use rayon::prelude::*;
use serde::Serialize;
use sspc_image::{Frame, HalfWeights, Image};
use std::fmt;

/// Blocks with noise that a statement needs.
pub const FEWEST_BLOCKS: usize = 40;
/// Cells of [`Independence::map`] a side.
pub const MAP_SIDE: usize = 8;
/// Rank of the block that texture, and a correlation that cannot be told from it, are seen by.
const QUARTILE: f64 = 0.25;
/// Rank of the block that bounds the correlation from above.
const TWENTIETH: f64 = 0.05;
/// How far below its correlation the lowest twentieth of the blocks of a frame lies by chance: 0.04 to 0.12 were seen.
const CHANCE: f64 = 0.1;
/// Distance of the twentieth from the quartile beyond which texture is at work: 0.04 to 0.09 without, 0.2 to 0.4 with.
const TEXTURED: f64 = 0.15;
/// A block counts when its noise, against its brightness, is at least this share of the frame's mean.
const LEAST_NOISE: f64 = 0.01;
/// Rows that one thread looks at, at a time.
const ROWS_PER_JOB: usize = 8;

/// What a frame's halves say of each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Independence {
    /// Correlation of the halves' noise, -1..1, apart from shared texture. None when too few blocks have noise.
    pub correlation: Option<f64>,
    /// Its standard error, by the spread of blocks.
    pub standard_error: f64,
    /// Whether texture that the denoiser blurred is at work, so that the noise may be less correlated or not at all.
    pub textured: bool,
    /// Median over blocks: shared texture included.
    pub median: f64,
    /// Energy of y - z of half a over that of half b, the median over blocks: about the inverse of their samples.
    pub noise_ratio: f64,
    /// That inverse, where the samples are known, else 1.
    pub expected_noise_ratio: f64,
    /// Brightness of z of half a over that of half b for R, G, B, the median over blocks.
    pub brightness: [f64; 3],
    /// Where the halves' albedo and normal have their edges; None without enough of them.
    pub alignment: Option<Alignment>,
    /// Median correlation of the blocks of each cell of the picture, row by row, in hundredths; None without noise.
    pub map: [[Option<i8>; MAP_SIDE]; MAP_SIDE],
}

impl fmt::Display for Independence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.correlation {
            Some(r) => write!(f, "correlation of the halves' noise {r:+.2} ± {:.2}", self.standard_error),
            None => write!(f, "correlation of the halves' noise unknown: too few blocks have noise"),
        }
    }
}

impl Default for Independence {
    /// Of halves of which nothing can be said.
    fn default() -> Self {
        Self {
            correlation: None,
            standard_error: 0.0,
            textured: false,
            median: 0.0,
            noise_ratio: 1.0,
            expected_noise_ratio: 1.0,
            brightness: [1.0; 3],
            alignment: None,
            map: [[None; MAP_SIDE]; MAP_SIDE],
        }
    }
}

/// Sums over the valid pixels of a block.
#[derive(Clone, Copy, Default)]
struct BlockSums {
    /// Σ of (r^a)², (r^b)², r^a r^b over three channels.
    residuals: [f64; 3],
    /// Σ (y^a - y^b)².
    noise: f64,
    /// Σ of ½ (z^a + z^b), squared.
    squared: f64,
    /// Σ z of each half and channel.
    colour: [[f64; 3]; 2],
    pixels: f64,
}

impl BlockSums {
    fn add(&mut self, other: &BlockSums) {
        self.residuals.iter_mut().zip(other.residuals).for_each(|(own, other)| *own += other);
        for (own, other) in self.colour.iter_mut().flatten().zip(other.colour.iter().flatten()) {
            *own += other;
        }
        self.noise += other.noise;
        self.squared += other.squared;
        self.pixels += other.pixels;
    }

    /// Correlation of the residuals, 0 without any.
    fn correlation(&self) -> f64 {
        let [a, b, ab] = self.residuals;
        if a > 0.0 && b > 0.0 { ab / (a * b).sqrt() } else { 0.0 }
    }
}

/// An [`Independence`] being measured over a picture's rows, in any bands from top to bottom.
pub struct IndependenceCollector {
    /// Rows of the picture so far.
    rows: usize,
    columns: usize,
    blocks: Vec<BlockSums>,
    sample: BlockSample,
    weights: HalfWeights,
}

impl IndependenceCollector {
    /// One that has looked at nothing of a picture of that many pixels.
    pub fn new(pixels: usize) -> Self {
        let (sample, weights) = (BlockSample::new(pixels), HalfWeights::EQUAL);
        Self { rows: 0, columns: 0, blocks: Vec::new(), sample, weights }
    }

    /// Looks at the next rows; `valid` `[1, H, W]` is 0 at missing pixels.
    pub fn look(&mut self, band: &Frame, valid: &Image) {
        self.columns = band.width().div_ceil(BLOCK);
        let last = (self.rows + band.height()).div_ceil(BLOCK) * self.columns;
        self.blocks.resize(last, BlockSums::default());
        let rows = (0..band.height()).into_par_iter().with_min_len(ROWS_PER_JOB);
        let sums = || rows.map(|y| row_sums(band, valid.row(0, y), y)).collect();
        let (of_rows, ()): (Vec<Vec<BlockSums>>, ()) = rayon::join(sums, || self.sample.look(band, valid));
        for (y, row) in of_rows.iter().enumerate() {
            let first = (self.rows + y) / BLOCK * self.columns;
            self.blocks[first..].iter_mut().zip(row).for_each(|(block, sums)| block.add(sums));
        }
        self.rows += band.height();
        self.weights = band.weights;
    }

    /// What the rows say.
    pub fn finish(&self) -> Independence {
        let relative = self.relative_noise();
        let mean = relative.iter().sum::<f64>() / relative.len().max(1) as f64;
        let noisy = |at: &usize| relative[*at] > 0.0 && relative[*at] >= LEAST_NOISE * mean;
        let noisy: Vec<usize> = (0..self.blocks.len()).filter(noisy).collect();
        let of = |value: &dyn Fn(&BlockSums) -> f64| noisy.iter().map(|&at| value(&self.blocks[at])).collect();
        let correlations = Sorted::new(of(&BlockSums::correlation));
        let enough = noisy.len() >= FEWEST_BLOCKS;
        let (quartile, twentieth) = (correlations.at(QUARTILE), correlations.at(TWENTIETH));
        let of_quartile = SharedNoise { correlation: quartile, standard_error: correlations.standard_error(QUARTILE) };
        let found = SharedNoise::of(&self.sample.blocks(|at| noisy.binary_search(&at).is_ok())).unwrap_or(of_quartile);
        let median_ratio =
            |value: &dyn Fn(&BlockSums) -> f64| if enough { Sorted::new(of(value)).at(0.5) } else { 1.0 };
        Independence {
            correlation: enough.then(|| found.correlation.min(twentieth + CHANCE)),
            standard_error: found.standard_error,
            textured: quartile - twentieth > TEXTURED,
            median: correlations.at(0.5),
            noise_ratio: median_ratio(&|block| ratio(block.residuals[0], block.residuals[1])),
            expected_noise_ratio: f64::from(self.weights.of(1)) / f64::from(self.weights.of(0)),
            brightness: [0, 1, 2].map(|k| median_ratio(&|block| ratio(block.colour[0][k], block.colour[1][k]))),
            alignment: Alignment::of(&self.sample.blocks(|_| true)),
            map: self.map(&noisy),
        }
    }

    /// Noise of every block against its brightness, as relL2 weighs it.
    fn relative_noise(&self) -> Vec<f64> {
        let pixels: f64 = self.blocks.iter().map(|block| block.pixels).sum();
        let colour: f64 = self.blocks.iter().flat_map(|block| block.colour).flatten().sum::<f64>() / 6.0;
        // The method's 0.01 at a mean of 0.25.
        let floor = 0.16 * (colour / pixels.max(1.0)).powi(2);
        let of = |block: &BlockSums| {
            let denominator = block.squared + floor * 3.0 * block.pixels;
            if denominator > 0.0 { block.noise / denominator } else { 0.0 }
        };
        self.blocks.iter().map(of).collect()
    }

    fn map(&self, noisy: &[usize]) -> [[Option<i8>; MAP_SIDE]; MAP_SIDE] {
        let rows = self.blocks.len() / self.columns.max(1);
        let mut cells: [[Vec<f64>; MAP_SIDE]; MAP_SIDE] = Default::default();
        for &at in noisy {
            let (y, x) = (at / self.columns, at % self.columns);
            cells[y * MAP_SIDE / rows][x * MAP_SIDE / self.columns].push(self.blocks[at].correlation());
        }
        let hundredths = |cell: Vec<f64>| (!cell.is_empty()).then(|| (100.0 * Sorted::new(cell).at(0.5)).round() as i8);
        cells.map(|row| row.map(hundredths))
    }
}

/// a / b where both are positive; far from 1 where only one is.
fn ratio(a: f64, b: f64) -> f64 {
    const FAR: f64 = 1e6;
    match (a > 0.0, b > 0.0) {
        (true, true) => (a / b).clamp(1.0 / FAR, FAR),
        (true, false) => FAR,
        (false, true) => 1.0 / FAR,
        (false, false) => 1.0,
    }
}

/// Sums of the pixels of row `y`, one for each block that it crosses.
fn row_sums(band: &Frame, valid: &[f32], y: usize) -> Vec<BlockSums> {
    let mut sums = vec![BlockSums::default(); valid.len().div_ceil(BLOCK)];
    let planes = |k| [&band.a.radiance, &band.a.denoised, &band.b.radiance, &band.b.denoised].map(|i| i.row(k, y));
    let planes = [planes(0), planes(1), planes(2)];
    for (block, first) in sums.iter_mut().zip((0..valid.len()).step_by(BLOCK)) {
        let columns = first..(first + BLOCK).min(valid.len());
        let valid = &valid[columns.clone()];
        block.pixels = valid.iter().filter(|valid| **valid != 0.0).count() as f64;
        for (k, planes) in planes.iter().enumerate() {
            let [y_a, z_a, y_b, z_b] = planes.map(|row| &row[columns.clone()]);
            let ([mut of_a, mut of_b, mut of_both], mut noise, mut squared) =
                (block.residuals, block.noise, block.squared);
            let [mut colour_a, mut colour_b] = [0.0; 2];
            for x in (0..valid.len()).filter(|x| valid[*x] != 0.0) {
                let [y_a, z_a, y_b, z_b] = [y_a[x], z_a[x], y_b[x], z_b[x]].map(f64::from);
                let (a, b, z) = (y_a - z_a, y_b - z_b, 0.5 * (z_a + z_b));
                of_a += a * a;
                of_b += b * b;
                of_both += a * b;
                noise += (y_a - y_b).powi(2);
                squared += z * z;
                colour_a += z_a;
                colour_b += z_b;
            }
            (block.residuals, block.noise, block.squared) = ([of_a, of_b, of_both], noise, squared);
            [block.colour[0][k], block.colour[1][k]] = [colour_a, colour_b];
        }
    }
    sums
}

/// Values in order.
struct Sorted(Vec<f64>);

impl Sorted {
    fn new(mut values: Vec<f64>) -> Self {
        values.sort_unstable_by(f64::total_cmp);
        Self(values)
    }

    /// The value of a rank 0..1, between neighbours in proportion; 0 of none.
    fn at(&self, rank: f64) -> f64 {
        let Some(last) = self.0.len().checked_sub(1) else { return 0.0 };
        let place = rank * last as f64;
        let (below, share) = (place.floor() as usize, place.fract());
        self.0[below] + share * (self.0[(below + 1).min(last)] - self.0[below])
    }

    /// Standard error of a quantile: √(p (1 - p) / n) over the density there, which the spread of a fifth of the values
    /// around it gives.
    fn standard_error(&self, rank: f64) -> f64 {
        const AROUND: f64 = 0.1;
        let width = self.at(rank + AROUND) - self.at(rank - AROUND);
        (rank * (1.0 - rank) / self.0.len().max(1) as f64).sqrt() * width / (2.0 * AROUND)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::rng::Rng;
    use sspc_image::HalfBuffer;

    const HEIGHT: usize = 192;
    const WIDTH: usize = 256;
    /// Five standard errors of the quartile (0.009 with 192 blocks of 768 values), and the 0.03 that a quartile lies
    /// below a median of as many.
    const NEAR: f64 = 0.075;

    /// Halves whose noise has correlation `rho`, around `texture(y, x)` that z lacks.
    pub(crate) fn frame(rho: f32, texture: impl Fn(usize, usize) -> f32) -> Frame {
        let rng = &mut Rng::new(7);
        let mut y = [0, 1].map(|_| Image::zeros(3, HEIGHT, WIDTH));
        for (c, row, x) in (0..3 * HEIGHT * WIDTH).map(|i| (i / WIDTH / HEIGHT, i / WIDTH % HEIGHT, i % WIDTH)) {
            let (a, own) = (rng.normal(), rng.normal());
            let b = rho * a + (1.0 - rho * rho).sqrt() * own;
            let noise = [a, b];
            y.iter_mut().zip(noise).for_each(|(y, n)| y.set(c, row, x, 1.0 + 0.1 * n + texture(row, x)));
        }
        let half = |radiance| HalfBuffer {
            radiance,
            denoised: Image::filled(3, HEIGHT, WIDTH, 1.0),
            albedo: None,
            normal: None,
            visibility: None,
        };
        let [a, b] = y.map(half);
        Frame::of_halves(a, b)
    }

    pub(crate) fn measured(frame: &Frame) -> Independence {
        let mut collector = IndependenceCollector::new(frame.height() * frame.width());
        collector.look(frame, &Image::filled(1, frame.height(), frame.width(), 1.0));
        collector.finish()
    }

    #[test]
    fn an_injected_correlation_comes_back_with_its_sign() {
        for rho in [-0.9f32, -0.5, -0.29, -0.1, 0.0, 0.1, 0.29, 0.5, 0.8, 0.95] {
            let found = measured(&frame(rho, |_, _| 0.0));
            let correlation = found.correlation.unwrap();
            assert!((correlation - f64::from(rho)).abs() < NEAR, "{rho}: {found:?}");
            assert!(!found.textured && found.standard_error < 0.02, "{rho}: {found:?}");
            let cell = f64::from(found.map[3][5].unwrap()) / 100.0;
            assert!((cell - f64::from(rho)).abs() < NEAR, "{rho}: {found:?}");
        }
    }

    /// Alternating by pixel, stronger from left to right: without the twentieth the correlation would be about 0.35.
    #[test]
    fn texture_that_both_halves_share_is_told_from_shared_noise() {
        let texture = |y: usize, x: usize| if (y + x).is_multiple_of(2) { 0.0012 } else { -0.0012 } * x as f32;
        let found = measured(&frame(0.0, texture));
        assert!(found.textured && found.median > 0.3, "{found:?}");
        assert!(found.correlation.unwrap() < 0.1 + NEAR, "{found:?}");
    }

    #[test]
    fn bands_of_any_height_say_the_same_as_the_whole() {
        let frame = frame(0.3, |_, _| 0.0);
        let mut collector = IndependenceCollector::new(frame.height() * frame.width());
        let mut top = 0;
        for rows in [5, 16, 1, 64, 100, 6] {
            collector.look(&frame.rows(top, rows), &Image::filled(1, rows, WIDTH, 1.0));
            top += rows;
        }
        assert_eq!(top, HEIGHT);
        assert_eq!(collector.finish(), measured(&frame));
    }

    #[test]
    fn too_few_blocks_say_nothing() {
        let small = frame(0.8, |_, _| 0.0).rows(0, 32);
        assert_eq!(measured(&small).correlation, None);
    }
}
