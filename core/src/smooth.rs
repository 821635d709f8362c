//! Box means of any radius in constant time per pixel.

use crate::image::Image;

/// Mean over the (2 radius + 1)² neighbours that lie inside the picture, f64 sums.
pub fn box_mean(image: &Image, radius: usize) -> Image {
    let (height, width) = (image.height(), image.width());
    let mut out = Image::zeros(image.channels(), height, width);
    for c in 0..image.channels() {
        let sums = row_sums(image.plane(c), height, width, radius);
        let mut column = vec![0.0f64; width];
        let add = |column: &mut [f64], y: usize, sign: f64| {
            column.iter_mut().zip(&sums[y * width..(y + 1) * width]).for_each(|(t, s)| *t += sign * s);
        };
        (0..radius.min(height)).for_each(|y| add(&mut column, y, 1.0));
        for y in 0..height {
            if y + radius < height {
                add(&mut column, y + radius, 1.0);
            }
            if y > radius {
                add(&mut column, y - radius - 1, -1.0);
            }
            let rows = (y + radius + 1).min(height) - y.saturating_sub(radius);
            for (x, total) in column.iter().enumerate() {
                let columns = (x + radius + 1).min(width) - x.saturating_sub(radius);
                out.set(c, y, x, (total / (rows * columns) as f64) as f32);
            }
        }
    }
    out
}

fn row_sums(plane: &[f32], height: usize, width: usize, radius: usize) -> Vec<f64> {
    let mut sums = Vec::with_capacity(height * width);
    let mut prefix = vec![0.0f64; width + 1];
    for row in plane.chunks_exact(width) {
        for (x, v) in row.iter().enumerate() {
            prefix[x + 1] = prefix[x] + f64::from(*v);
        }
        sums.extend((0..width).map(|x| prefix[(x + radius + 1).min(width)] - prefix[x.saturating_sub(radius)]));
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_equal_those_of_the_neighbours_one_by_one() {
        for (height, width, radius) in [(1, 1, 3), (5, 9, 2), (9, 4, 7), (12, 13, 0)] {
            let image = Image::from_fn(1, height, width, |_, y, x| ((y * 31 + x * 17) % 23) as f32);
            let fast = box_mean(&image, radius);
            for y in 0..height {
                for x in 0..width {
                    let rows = y.saturating_sub(radius)..(y + radius + 1).min(height);
                    let columns = x.saturating_sub(radius)..(x + radius + 1).min(width);
                    let n = rows.len() * columns.len();
                    let sum: f32 = rows.flat_map(|y| columns.clone().map(move |x| (y, x))).map(|(y, x)| image.at(0, y, x)).sum();
                    assert!((fast.at(0, y, x) - sum / n as f32).abs() < 1e-4, "({y}, {x}) of {height}x{width}");
                }
            }
        }
    }
}
