//! The temporal mean m_t = (z_t + Σ_f v_f W z_f) / (1 + Σ_f v_f) over the neighbours f of frame t.

use crate::field::Field;
use crate::warp::{CubicTaps, Taps, for_rows};
use sspc_image::Image;

/// A mean being made, of one or more pictures of one buffer along the same motion.
pub struct TemporalMean {
    /// Σ v W z of each picture, `[3, H, W]`.
    sums: Vec<Image>,
    /// Σ v, `[1, H, W]`.
    weight: Image,
}

impl TemporalMean {
    /// The mean of `pictures` pictures of this size, so far without neighbours.
    pub fn new(pictures: usize, height: usize, width: usize) -> Self {
        let sums = (0..pictures).map(|_| Image::zeros(3, height, width)).collect();
        Self { sums, weight: Image::zeros(1, height, width) }
    }

    /// Adds the neighbour's pictures, in the order of the centre's, where they are valid. Places whose taps are not all
    /// finite in every picture add nothing.
    ///
    /// # Panics
    /// When number or sizes differ.
    pub fn add(&mut self, pictures: &[&Image], field: &Field, valid: &Image) {
        assert_eq!(pictures.len(), self.sums.len(), "pictures of the neighbour");
        let same = |image: &Image| image.same_size(&self.weight);
        assert!(pictures.iter().all(|image| same(image)) && same(field) && same(valid), "a neighbour of one size");
        let (height, width) = (field.height(), field.width());
        let planes: Vec<&[f32]> = pictures.iter().flat_map(|image| (0..3).map(move |c| image.plane(c))).collect();
        let mut images: Vec<&mut Image> = self.sums.iter_mut().chain([&mut self.weight]).collect();
        for_rows(&mut images, |y, rows| {
            let (dx, dy, valid) = (field.row(0, y), field.row(1, y), valid.row(0, y));
            let Some((weight, sums)) = rows.split_last_mut() else { return };
            let mut values = vec![0.0f32; sums.len()];
            for x in (0..width).filter(|x| valid[*x] > 0.0) {
                let Some(taps) = Taps::at(x as f32 + dx[x], y as f32 + dy[x], height, width) else { continue };
                let taps = CubicTaps::of(&taps, height, width);
                values.iter_mut().zip(&planes).for_each(|(value, plane)| *value = taps.sample(plane));
                if values.iter().all(|value| value.is_finite()) {
                    sums.iter_mut().zip(&values).for_each(|(sum, value)| sum[x] += valid[x] * value);
                    weight[x] += valid[x];
                }
            }
        });
    }

    /// The means, in the order of the frame's own pictures: those, where nothing was added.
    ///
    /// # Panics
    /// When number or sizes differ.
    pub fn finish(self, own: &[&Image]) -> Vec<Image> {
        assert_eq!(own.len(), self.sums.len(), "pictures of the frame");
        let weight = self.weight;
        let of = |(mut sum, own): (Image, &&Image)| {
            sum.for_each_row(|c, y, row| {
                for ((m, z), w) in row.iter_mut().zip(own.row(c, y)).zip(weight.row(0, y)) {
                    // Without neighbours z stays as it is, bit for bit.
                    *m = if *w > 0.0 { (*z + *m) / (1.0 + w) } else { *z };
                }
            });
            sum
        };
        self.sums.into_iter().zip(own).map(of).collect()
    }
}
