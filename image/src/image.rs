//! Planar f32 images, the one container that every stage passes on.

use rayon::prelude::*;

/// Fewest values that are worth another thread.
const LEAST_SHARE: usize = 1 << 14;

/// A planar image `[channels, height, width]` of f32, rows from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct Image {
    channels: usize,
    height: usize,
    width: usize,
    data: Vec<f32>,
}

impl Image {
    /// An image filled with `value`.
    pub fn filled(channels: usize, height: usize, width: usize, value: f32) -> Self {
        Self { channels, height, width, data: vec![value; channels * height * width] }
    }

    /// An image of zeros.
    pub fn zeros(channels: usize, height: usize, width: usize) -> Self {
        Self::filled(channels, height, width, 0.0)
    }

    /// Takes ownership of planar samples.
    ///
    /// # Panics
    /// When `data` does not hold `channels * height * width` values.
    pub fn from_planes(channels: usize, height: usize, width: usize, data: Vec<f32>) -> Self {
        assert_eq!(data.len(), channels * height * width, "planar samples of {channels}x{height}x{width}");
        Self { channels, height, width, data }
    }

    /// Builds an image from one function of (channel, y, x).
    pub fn from_fn(
        channels: usize,
        height: usize,
        width: usize,
        mut value: impl FnMut(usize, usize, usize) -> f32,
    ) -> Self {
        let mut data = Vec::with_capacity(channels * height * width);
        for c in 0..channels {
            for y in 0..height {
                for x in 0..width {
                    data.push(value(c, y, x));
                }
            }
        }
        Self { channels, height, width, data }
    }

    /// Builds an image on all threads from a function that fills the row (channel, y).
    pub fn from_rows(
        channels: usize,
        height: usize,
        width: usize,
        fill: impl Fn(usize, usize, &mut [f32]) + Sync,
    ) -> Self {
        let mut image = Self::zeros(channels, height, width);
        image.for_each_row(fill);
        image
    }

    /// Hands every row (channel, y) to `change`, on all threads.
    pub fn for_each_row(&mut self, change: impl Fn(usize, usize, &mut [f32]) + Sync) {
        let (height, width) = (self.height, self.width);
        if self.data.is_empty() {
            return;
        }
        let rows = self.data.par_chunks_exact_mut(width).with_min_len(LEAST_SHARE.div_ceil(width)).enumerate();
        rows.for_each(|(row, values)| change(row / height, row % height, values));
    }

    /// Planes.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels of one plane, `height * width`.
    pub fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// All planes, one after another.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// All planes, one after another.
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// Gives the planes away.
    pub fn into_data(self) -> Vec<f32> {
        self.data
    }

    /// Plane `c` as `height * width` values.
    pub fn plane(&self, c: usize) -> &[f32] {
        &self.data[c * self.pixels()..(c + 1) * self.pixels()]
    }

    /// Row `y` of plane `c`.
    pub fn row(&self, c: usize, y: usize) -> &[f32] {
        &self.data[(c * self.height + y) * self.width..][..self.width]
    }

    /// Plane `c` as `height * width` values.
    pub fn plane_mut(&mut self, c: usize) -> &mut [f32] {
        let pixels = self.pixels();
        &mut self.data[c * pixels..(c + 1) * pixels]
    }

    /// Every plane by itself.
    pub fn all_planes_mut(&mut self) -> std::slice::ChunksExactMut<'_, f32> {
        let pixels = self.pixels().max(1);
        self.data.chunks_exact_mut(pixels)
    }

    /// The three planes of a picture of three channels.
    ///
    /// # Panics
    /// When there are other channels.
    pub fn planes_mut(&mut self) -> [&mut [f32]; 3] {
        assert_eq!(self.channels, 3, "channels of a picture");
        let pixels = self.pixels();
        let (r, rest) = self.data.split_at_mut(pixels);
        let (g, b) = rest.split_at_mut(pixels);
        [r, g, b]
    }

    /// Value of plane `c` at row `y`, column `x`.
    pub fn at(&self, c: usize, y: usize, x: usize) -> f32 {
        self.data[(c * self.height + y) * self.width + x]
    }

    /// Changes the value of plane `c` at row `y`, column `x`.
    pub fn set(&mut self, c: usize, y: usize, x: usize, value: f32) {
        self.data[(c * self.height + y) * self.width + x] = value;
    }

    /// Same width and height, whatever the channels.
    pub fn same_size(&self, other: &Image) -> bool {
        self.height == other.height && self.width == other.width
    }

    /// The rectangle at (`top`, `left`) of `height` x `width` pixels.
    ///
    /// # Panics
    /// When the rectangle leaves the image.
    pub fn crop(&self, top: usize, left: usize, height: usize, width: usize) -> Image {
        assert!(top + height <= self.height && left + width <= self.width, "crop leaves the image");
        let mut data = Vec::with_capacity(self.channels * height * width);
        for c in 0..self.channels {
            for y in top..top + height {
                let start = (c * self.height + y) * self.width + left;
                data.extend_from_slice(&self.data[start..start + width]);
            }
        }
        Image { channels: self.channels, height, width, data }
    }

    /// Puts the rows of an image of the same channels and width in the place of those from `top` on.
    ///
    /// # Panics
    /// When they do not fit.
    pub fn put_rows(&mut self, top: usize, rows: &Image) {
        assert_eq!((rows.channels, rows.width), (self.channels, self.width), "channels and width of the rows");
        let from = top * self.width;
        for c in 0..self.channels {
            self.plane_mut(c)[from..from + rows.pixels()].copy_from_slice(rows.plane(c));
        }
    }

    /// The mean of two images of one shape; of finite values it is finite.
    pub fn mean_of(a: &Image, b: &Image) -> Image {
        assert!(a.same_size(b) && a.channels == b.channels, "mean of images of one shape");
        Self::from_rows(a.channels, a.height, a.width, |c, y, row| {
            for ((v, a), b) in row.iter_mut().zip(a.row(c, y)).zip(b.row(c, y)) {
                *v = 0.5 * a + 0.5 * b;
            }
        })
    }
}
