//! Box means of any radius in constant time per pixel, by additions only (van Herk 1992, Gil and
//! Werman 1993): a bright value stays in the windows that hold it, which running sums that subtract
//! what leaves the window do not guarantee.

use crate::Image;
use rayon::prelude::*;

/// Rows that one thread takes at a time.
const ROWS_PER_JOB: usize = 16;

/// Mean over the (2 radius + 1)² neighbours that lie inside the picture, f64 sums. The same bits for
/// any number of threads.
pub fn box_mean(image: &Image, radius: usize) -> Image {
    let (height, width) = (image.height(), image.width());
    let mut out = Image::zeros(image.channels(), height, width);
    if out.data().is_empty() {
        return out;
    }
    for c in 0..image.channels() {
        let rows = row_sums(image, c, radius);
        // Output rows that begin a block of the column's windows need that block and the next one.
        let blocks = out.plane_mut(c).par_chunks_mut((2 * radius + 1) * width).enumerate();
        blocks.for_each(|(block, out)| column_means(&rows, height, width, radius, block, out));
    }
    out
}

/// Pixels of `0..n` within `radius` of `i`.
fn inside(i: usize, n: usize, radius: usize) -> usize {
    (i + radius + 1).min(n) - i.saturating_sub(radius)
}

/// Window sums along every row of a plane, `[H, W]`.
fn row_sums(image: &Image, c: usize, radius: usize) -> Vec<f64> {
    let (height, width) = (image.height(), image.width());
    let mut sums = vec![0.0; height * width];
    let rows = sums.par_chunks_exact_mut(width).with_min_len(ROWS_PER_JOB).enumerate();
    let scratch = || Scratch::new(width, radius);
    rows.for_each_init(scratch, |scratch, (y, sums)| scratch.window_sums(image.row(c, y), radius, sums));
    sums
}

/// A row with zeros around it, cut into blocks of one window's length: every window is the end of one block and the beginning
/// of the next.
struct Scratch {
    padded: Vec<f64>,
    /// Sums from each value to the end of its block.
    suffix: Vec<f64>,
}

impl Scratch {
    fn new(width: usize, radius: usize) -> Self {
        let end = (width + 2 * radius).next_multiple_of(2 * radius + 1);
        Self { padded: vec![0.0; end], suffix: vec![0.0; end] }
    }

    /// Sums over 2 radius + 1 neighbours, zero outside.
    fn window_sums(&mut self, line: &[f32], radius: usize, sums: &mut [f64]) {
        let length = 2 * radius + 1;
        self.padded[radius..].iter_mut().zip(line).for_each(|(value, v)| *value = f64::from(*v));
        self.suffix.copy_from_slice(&self.padded);
        for block in self.suffix.chunks_exact_mut(length) {
            let mut sum = 0.0;
            for value in block.iter_mut().rev() {
                sum += *value;
                *value = sum;
            }
        }
        let blocks = sums.chunks_mut(length).zip(self.suffix.chunks_exact(length)).enumerate();
        for (block, (sums, suffix)) in blocks {
            sums[0] = suffix[0];
            let mut prefix = 0.0;
            let next = self.padded.get((block + 1) * length..).unwrap_or_default();
            for ((sum, suffix), value) in sums[1..].iter_mut().zip(&suffix[1..]).zip(next) {
                prefix += value;
                *sum = suffix + prefix;
            }
        }
    }
}

/// Means of the 2 radius + 1 rows `block * (2 radius + 1)..` (fewer at the bottom) of a plane whose
/// rows are summed already: the same sums as along the rows, for all columns at once.
fn column_means(rows: &[f64], height: usize, width: usize, radius: usize, block: usize, out: &mut [f32]) {
    let length = 2 * radius + 1;
    let first = block * length;
    let row = |i: usize| i.checked_sub(radius).filter(|&y| y < height).map(|y| &rows[y * width..][..width]);
    let mut suffix = vec![0.0; length * width];
    for j in (0..length).rev() {
        let (this, below) = suffix[j * width..].split_at_mut(width);
        let below = if j + 1 < length { &below[..width] } else { &[] };
        match (row(first + j), below) {
            (Some(row), []) => this.copy_from_slice(row),
            (Some(row), below) => this.iter_mut().zip(row).zip(below).for_each(|((sum, v), below)| *sum = below + v),
            (None, below) => this[..below.len()].copy_from_slice(below),
        }
    }
    let counted: Vec<f64> = (0..width).map(|x| inside(x, width, radius) as f64).collect();
    let mut prefix = vec![0.0; width];
    for (j, (out, suffix)) in out.chunks_exact_mut(width).zip(suffix.chunks_exact(width)).enumerate() {
        if let Some(row) = row(first + j + 2 * radius).filter(|_| j > 0) {
            prefix.iter_mut().zip(row).for_each(|(sum, v)| *sum += v);
        }
        let rows = inside(first + j, height, radius) as f64;
        for (((mean, suffix), prefix), columns) in out.iter_mut().zip(suffix).zip(&prefix).zip(&counted) {
            *mean = ((suffix + prefix) / (rows * columns)) as f32;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn mean_one_by_one(image: &Image, radius: usize, y: usize, x: usize) -> f64 {
        let rows = y.saturating_sub(radius)..(y + radius + 1).min(image.height());
        let columns = x.saturating_sub(radius)..(x + radius + 1).min(image.width());
        let n = rows.len() * columns.len();
        let sum: f64 = rows.flat_map(|y| columns.clone().map(move |x| f64::from(image.at(0, y, x)))).sum();
        sum / n as f64
    }

    #[test]
    fn means_equal_those_of_the_neighbours_one_by_one() {
        for (height, width, radius) in [(1, 1, 3), (5, 9, 2), (9, 4, 7), (12, 13, 0), (40, 31, 15)] {
            let image = Image::from_fn(1, height, width, |_, y, x| ((y * 31 + x * 17) % 23) as f32);
            let fast = box_mean(&image, radius);
            for y in 0..height {
                for x in 0..width {
                    let mean = mean_one_by_one(&image, radius, y, x);
                    assert!((f64::from(fast.at(0, y, x)) - mean).abs() < 1e-5, "({y}, {x}) of {height}x{width}");
                }
            }
        }
    }

    #[test]
    fn a_bright_pixel_stays_in_its_windows() {
        let mut image = Image::filled(1, 20, 30, 1e-3);
        image.set(0, 4, 5, 1e12);
        let mean = box_mean(&image, 3);
        for (y, x) in [(4, 9), (8, 5), (19, 29), (4, 29), (0, 0)] {
            let error = f64::from(mean.at(0, y, x)) / mean_one_by_one(&image, 3, y, x) - 1.0;
            assert!(error.abs() < 1e-6, "({y}, {x}): {error:e}");
        }
    }
}
