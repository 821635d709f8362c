//! Whether the features of both halves lie in the same places.
//!
//! Edges of albedo and normal (differences of neighbours in a row) of half a are compared with those of half b, moved by
//! up to four pixels: the correlation is largest without a move, however noisy the features are. (Of 16 frames of
//! three renderers the next best place has 0.3 to 0.75 of it; depth of field left 0.08 of it at 16 samples a pixel.)
//! Where noise hides even that, edges between cells of 4x4 pixels tell: 0.76 there, 0.01 of different
//! pictures.

use crate::block_sample::{AREA, Block, FEATURES};
use crate::estimate::BLOCK;
use crate::lanes::widest;
use rayon::prelude::*;
use serde::Serialize;
use sspc_kernels::simd::{Kernel, Simd};

/// Farthest move that is tried, pixels.
const REACH: usize = 4;
/// Side of a cell, pixels.
const CELL: usize = 4;
/// Blocks with edges that a statement needs.
const FEWEST_BLOCKS: usize = 12;
/// Mean square of a feature's difference between neighbours below which a block has no edges to compare.
const LEAST_EDGE: f64 = 1e-4;
/// Part of the best place's correlation that the halves' own must reach: patterns that repeat have several best places.
const AS_GOOD: f64 = 0.85;
/// Standard errors that are no chance: 81 places are looked at.
const NO_CHANCE: f64 = 4.0;

/// How the halves' features lie to each other.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Alignment {
    /// Correlation of edges between pixels, the median over blocks, -1..1.
    pub edges: f64,
    /// Whether that is more than chance makes it.
    pub seen: bool,
    /// Correlation of edges between cells, the median over blocks, -1..1.
    pub cells: f64,
    /// How far half b lies to the right of and below half a, pixels: where the edges fit decidedly better.
    pub offset: [i32; 2],
}

impl Alignment {
    /// What blocks say; `None` of too few with edges.
    pub(crate) fn of(blocks: &[&Block]) -> Option<Self> {
        let of_blocks: Vec<OfBlock> = blocks.par_iter().filter_map(|block| widest(Compare(block.features()))).collect();
        if of_blocks.len() < FEWEST_BLOCKS {
            return None;
        }
        let places: Vec<Median> = (0..PLACES).map(|i| Median::of(&of_blocks, |block| block.places[i])).collect();
        let own = places[UNMOVED];
        let (best, place) = (0..PLACES).map(|i| (places[i], i)).max_by(|p, q| p.0.value.total_cmp(&q.0.value))?;
        let better = best.value - own.value;
        let is_moved = better > NO_CHANCE * best.standard_error && own.value < AS_GOOD * best.value;
        let (down, right) = if is_moved { move_of(place) } else { (0, 0) };
        Some(Self {
            edges: own.value,
            seen: own.value > NO_CHANCE * own.standard_error,
            cells: Median::of(&of_blocks, |block| block.cells).value,
            offset: [right, down],
        })
    }
}

/// Moves that are tried.
const PLACES: usize = (2 * REACH + 1) * (2 * REACH + 1);
/// That of none.
const UNMOVED: usize = PLACES / 2;

/// Rows and columns of a move.
fn move_of(place: usize) -> (i32, i32) {
    let (side, reach) = (2 * REACH as i32 + 1, REACH as i32);
    (place as i32 / side - reach, place as i32 % side - reach)
}

/// Correlations of a block's edges.
struct OfBlock {
    places: [f64; PLACES],
    cells: f64,
}

/// Compares planes of both halves' features, half a's first; none without edges.
struct Compare<'a>(&'a [f32]);

impl Kernel for Compare<'_> {
    type Output = Option<OfBlock>;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Option<OfBlock> {
        let (mut places, mut cells) = ([Sums::default(); PLACES], Sums::default());
        let (a, b) = self.0.split_at(FEATURES * AREA);
        for (a, b) in a.chunks_exact(AREA).zip(b.chunks_exact(AREA)) {
            // A feature that is missing somewhere in the block says nothing there.
            if a.iter().chain(b).all(|value| value.is_finite()) {
                add_moved(&mut places, &edges(a), &edges(b));
                add_cells(&mut cells, [a, b].map(cell_means));
            }
        }
        let pixels = (BLOCK * (BLOCK - 1)) as f64;
        let has_edges = places[UNMOVED].energy() > LEAST_EDGE * pixels;
        has_edges.then(|| OfBlock { places: places.map(Sums::correlation), cells: cells.correlation() })
    }
}

/// Σ a², b² and a b.
#[derive(Clone, Copy, Default)]
struct Sums([f64; 3]);

impl Sums {
    fn add(&mut self, a: f32, b: f32) {
        let (a, b) = (f64::from(a), f64::from(b));
        self.0.iter_mut().zip([a * a, b * b, a * b]).for_each(|(sum, product)| *sum += product);
    }

    fn energy(&self) -> f64 {
        0.5 * (self.0[0] + self.0[1])
    }

    fn correlation(self) -> f64 {
        if self.energy() > 0.0 { self.0[2] / self.energy() } else { 0.0 }
    }
}

/// Differences of neighbours in a row, 0 in the last column.
fn edges(plane: &[f32]) -> [f32; AREA] {
    std::array::from_fn(|i| if i % BLOCK + 1 < BLOCK { plane[i + 1] - plane[i] } else { 0.0 })
}

/// Pixels a side that stay inside the block wherever they are moved.
const INNER: usize = BLOCK - 1 - 2 * REACH;

/// Adds edges of half a, and those of half b at every place, where every move stays inside the block: by columns, whose sums do not
/// wait for one another.
#[inline(always)]
fn add_moved(places: &mut [Sums; PLACES], a: &[f32; AREA], b: &[f32; AREA]) {
    let inner = |plane: &[f32; AREA], top: usize, left: usize| -> [f64; INNER] {
        let mut row = [0.0; INNER];
        for (x, value) in row.iter_mut().enumerate() {
            *value = f64::from(plane[top * BLOCK + left + x]);
        }
        row
    };
    let side = 2 * REACH + 1;
    for (place, sums) in places.iter_mut().enumerate() {
        let (down, right) = (place / side, place % side);
        let mut columns = [[0.0; INNER]; 3];
        for y in 0..INNER {
            let (a, b) = (inner(a, REACH + y, REACH), inner(b, down + y, right));
            for x in 0..INNER {
                columns[0][x] += a[x] * a[x];
                columns[1][x] += b[x] * b[x];
                columns[2][x] += a[x] * b[x];
            }
        }
        for (sum, columns) in sums.0.iter_mut().zip(&columns) {
            *sum += columns.iter().sum::<f64>();
        }
    }
}

/// Cells of a block.
const CELLS: usize = BLOCK / CELL;

fn cell_means(plane: &[f32]) -> [[f32; CELLS]; CELLS] {
    let mut means = [[0.0; CELLS]; CELLS];
    for (i, value) in plane.iter().enumerate() {
        means[i / BLOCK / CELL][i % BLOCK / CELL] += value / (CELL * CELL) as f32;
    }
    means
}

/// Adds the differences of neighbouring cells.
fn add_cells(sums: &mut Sums, [a, b]: [[[f32; CELLS]; CELLS]; 2]) {
    for (y, x) in (0..CELLS).flat_map(|y| (1..CELLS).map(move |x| (y, x))) {
        sums.add(a[y][x] - a[y][x - 1], b[y][x] - b[y][x - 1]);
        sums.add(a[x][y] - a[x - 1][y], b[x][y] - b[x - 1][y]);
    }
}

/// The median over blocks, the upper one of two, and its standard error as of a normal distribution.
#[derive(Clone, Copy)]
struct Median {
    value: f64,
    standard_error: f64,
}

impl Median {
    fn of(blocks: &[OfBlock], of_block: impl Fn(&OfBlock) -> f64) -> Self {
        let mut values: Vec<f64> = blocks.iter().map(of_block).collect();
        values.sort_unstable_by(f64::total_cmp);
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let spread = (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt();
        Self { value: values[values.len() / 2], standard_error: 1.2533 * spread / count.sqrt() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::independence::tests::{frame, measured};
    use crate::rng::Rng;
    use sspc_image::{Frame, Image};

    /// Discs of albedo, moved, under noise of a half.
    fn with_albedo(noise: f32, seed: u64, down: usize, right: usize) -> Frame {
        let mut frame = frame(0.0, |_, _| 0.0);
        let discs: Vec<[f32; 4]> = {
            let rng = &mut Rng::new(seed);
            (0..300).map(|_| [0; 4].map(|_| rng.uniform())).collect()
        };
        let albedo = |y: usize, x: usize| {
            let inside = |[top, left, radius, _]: &&[f32; 4]| {
                (y as f32 - 192.0 * top).powi(2) + (x as f32 - 256.0 * left).powi(2) < (12.0 * radius).powi(2)
            };
            discs.iter().rev().find(inside).map_or(0.5, |disc| disc[3])
        };
        let rng = &mut Rng::new(11);
        let mut noisy = |down: usize, right: usize| {
            Image::from_fn(3, 192, 256, |_, y, x| {
                albedo((y + 192 - down) % 192, (x + 256 - right) % 256) + noise * rng.normal()
            })
        };
        (frame.a.albedo, frame.b.albedo) = (Some(noisy(0, 0)), Some(noisy(down, right)));
        frame
    }

    fn found(frame: &Frame) -> Alignment {
        measured(frame).alignment.expect("enough blocks with edges")
    }

    #[test]
    fn noise_hides_no_edges() {
        for noise in [0.0, 0.1, 0.5] {
            let found = found(&with_albedo(noise, 1, 0, 0));
            assert!((found.seen || found.cells > 0.3) && found.offset == [0, 0], "{noise}: {found:?}");
        }
    }

    #[test]
    fn a_move_is_found_with_its_direction() {
        for (noise, down, right) in [(0.0, 0, 1), (0.1, 1, 0), (0.3, 4, 3)] {
            let found = found(&with_albedo(noise, 1, down, right));
            assert_eq!(found.offset, [right as i32, down as i32], "{noise}: {found:?}");
        }
    }

    #[test]
    fn other_pictures_have_no_edges_in_common() {
        let mut frame = with_albedo(0.1, 1, 0, 0);
        frame.b.albedo = with_albedo(0.1, 2, 0, 0).b.albedo;
        let found = found(&frame);
        assert!(!found.seen && found.cells < 0.2 || found.offset != [0, 0], "{found:?}");
    }

    /// Stripes of four pixels fit as well two stripes away.
    #[test]
    fn a_pattern_that_repeats_is_not_moved() {
        let mut frame = frame(0.0, |_, _| 0.0);
        let stripes = || Some(Image::from_fn(3, 192, 256, |_, _, x| (x % 2) as f32));
        (frame.a.albedo, frame.b.albedo) = (stripes(), stripes());
        assert_eq!(measured(&frame).alignment.map(|found| found.offset), Some([0, 0]));
    }
}
