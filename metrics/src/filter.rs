//! Separable filters on planes, edge pixels repeated beyond the border.

use rayon::prelude::*;

/// A plane `[H, W]` of f32.
#[derive(Clone, Debug, PartialEq)]
pub struct Plane {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Row by row.
    pub data: Vec<f32>,
}

impl Plane {
    /// A plane made pixel by pixel from its index.
    pub fn from_fn(width: usize, height: usize, value: impl Fn(usize) -> f32 + Sync + Send) -> Self {
        Self { width, height, data: (0..width * height).into_par_iter().map(value).collect() }
    }

    /// Correlates rows with `across` and columns with `down`, both of odd length, centred; f64 sums.
    pub fn filtered(&self, across: &[f64], down: &[f64]) -> Plane {
        self.rows(across).columns(down)
    }

    fn rows(&self, taps: &[f64]) -> Plane {
        let radius = taps.len() / 2;
        let mut data = vec![0.0f32; self.data.len()];
        if self.width > 0 {
            data.par_chunks_mut(self.width).zip(self.data.par_chunks(self.width)).for_each(|(out, row)| {
                for (x, out) in out.iter_mut().enumerate() {
                    let tap = |(i, weight): (usize, &f64)| weight * f64::from(row[clamped(x + i, radius, self.width)]);
                    *out = taps.iter().enumerate().map(tap).sum::<f64>() as f32;
                }
            });
        }
        Plane { data, ..*self }
    }

    fn columns(&self, taps: &[f64]) -> Plane {
        let radius = taps.len() / 2;
        let mut data = vec![0.0f32; self.data.len()];
        if self.width > 0 {
            data.par_chunks_mut(self.width).enumerate().for_each(|(y, out)| {
                let mut sums = vec![0.0f64; self.width];
                for (i, weight) in taps.iter().enumerate() {
                    let start = clamped(y + i, radius, self.height) * self.width;
                    let row = &self.data[start..start + self.width];
                    sums.iter_mut().zip(row).for_each(|(sum, value)| *sum += weight * f64::from(*value));
                }
                out.iter_mut().zip(&sums).for_each(|(out, sum)| *out = *sum as f32);
            });
        }
        Plane { data, ..*self }
    }
}

/// `at - radius`, kept inside `0..length`.
fn clamped(at: usize, radius: usize, length: usize) -> usize {
    at.saturating_sub(radius).min(length - 1)
}

/// `exp(-x² / (2σ²))` at whole x within `radius`, not normalised.
pub fn gaussian(sigma: f64, radius: usize) -> Vec<f64> {
    offsets(radius).map(|x| (-x * x / (2.0 * sigma * sigma)).exp()).collect()
}

/// Whole numbers from `-radius` to `radius`.
pub fn offsets(radius: usize) -> impl Iterator<Item = f64> {
    (-(radius as i64)..=radius as i64).map(|x| x as f64)
}

/// Scales weights to a sum of 1.
pub fn normalised(mut weights: Vec<f64>) -> Vec<f64> {
    let sum: f64 = weights.iter().sum();
    weights.iter_mut().for_each(|weight| *weight /= sum);
    weights
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn borders_repeat_and_small_planes_work() {
        let plane = Plane { width: 3, height: 1, data: vec![1.0, 2.0, 4.0] };
        assert_eq!(plane.filtered(&[1.0, 0.0, 0.0], &[1.0]).data, [1.0, 1.0, 2.0]);
        assert_eq!(plane.filtered(&[0.0, 0.0, 1.0], &[0.0, 0.0, 1.0]).data, [2.0, 4.0, 4.0]);
        let one = Plane { width: 1, height: 1, data: vec![3.0] };
        assert_eq!(one.filtered(&[0.25; 9], &[1.0]).data, [6.75]);
    }
}
