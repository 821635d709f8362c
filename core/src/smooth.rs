//! Box means of any radius in constant time per pixel, by additions only (van Herk 1992, Gil and
//! Werman 1993): a bright value stays in the windows that hold it, which running sums that subtract
//! what leaves the window do not guarantee.

use crate::image::Image;

/// Mean over the (2 radius + 1)² neighbours that lie inside the picture, f64 sums.
pub fn box_mean(image: &Image, radius: usize) -> Image {
    let (height, width) = (image.height(), image.width());
    let mut out = Image::zeros(image.channels(), height, width);
    let inside = |i: usize, n: usize| (i + radius + 1).min(n) - i.saturating_sub(radius);
    for c in 0..image.channels() {
        let mut rows = Vec::with_capacity(height * width);
        for row in image.plane(c).chunks_exact(width) {
            let row: Vec<f64> = row.iter().map(|v| f64::from(*v)).collect();
            rows.extend(window_sums(&row, radius));
        }
        for x in 0..width {
            let column: Vec<f64> = (0..height).map(|y| rows[y * width + x]).collect();
            for (y, sum) in window_sums(&column, radius).into_iter().enumerate() {
                out.set(c, y, x, (sum / (inside(y, height) * inside(x, width)) as f64) as f32);
            }
        }
    }
    out
}

/// Sums over 2 radius + 1 neighbours, zero outside: every window is the end of one block of that
/// length and the beginning of the next.
fn window_sums(line: &[f64], radius: usize) -> Vec<f64> {
    let (n, length) = (line.len(), 2 * radius + 1);
    let mut prefix = vec![0.0; (n + 2 * radius).next_multiple_of(length)];
    prefix[radius..radius + n].copy_from_slice(line);
    let mut suffix = prefix.clone();
    for i in 1..prefix.len() {
        if i % length != 0 {
            prefix[i] += prefix[i - 1];
        }
    }
    for i in (0..suffix.len() - 1).rev() {
        if (i + 1) % length != 0 {
            suffix[i] += suffix[i + 1];
        }
    }
    (0..n).map(|x| if x % length == 0 { suffix[x] } else { suffix[x] + prefix[x + 2 * radius] }).collect()
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
