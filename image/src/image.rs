//! Planar f32 images, which every stage takes and returns.

use rayon::prelude::*;

/// Fewest values worth a thread of their own.
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

    /// Calls `change` with every row (channel, y), on all threads.
    pub fn for_each_row(&mut self, change: impl Fn(usize, usize, &mut [f32]) + Sync) {
        let (height, width) = (self.height, self.width);
        if self.data.is_empty() {
            return;
        }
        let rows = self.data.par_chunks_exact_mut(width).with_min_len(LEAST_SHARE.div_ceil(width)).enumerate();
        rows.for_each(|(row, values)| change(row / height, row % height, values));
    }

    /// Number of planes.
    #[inline]
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Height in pixels.
    #[inline]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Width in pixels.
    #[inline]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels of one plane, `height * width`.
    #[inline]
    pub fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// All planes, one after another.
    #[inline]
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// All planes, one after another, to be changed.
    #[inline]
    pub fn data_mut(&mut self) -> &mut [f32] {
        &mut self.data
    }

    /// All planes, one after another, without the image.
    pub fn into_data(self) -> Vec<f32> {
        self.data
    }

    /// Plane `c` as `height * width` values.
    #[inline]
    pub fn plane(&self, c: usize) -> &[f32] {
        &self.data[c * self.pixels()..(c + 1) * self.pixels()]
    }

    /// Row `y` of plane `c`.
    #[inline]
    pub fn row(&self, c: usize, y: usize) -> &[f32] {
        &self.data[(c * self.height + y) * self.width..][..self.width]
    }

    /// Plane `c`, to be changed.
    #[inline]
    pub fn plane_mut(&mut self, c: usize) -> &mut [f32] {
        let pixels = self.pixels();
        &mut self.data[c * pixels..(c + 1) * pixels]
    }

    /// Iterates over the planes.
    pub fn all_planes_mut(&mut self) -> std::slice::ChunksExactMut<'_, f32> {
        let pixels = self.pixels().max(1);
        self.data.chunks_exact_mut(pixels)
    }

    /// The three planes of a picture.
    ///
    /// # Panics
    /// Unless there are three channels.
    #[inline]
    pub fn planes_mut(&mut self) -> [&mut [f32]; 3] {
        assert_eq!(self.channels, 3, "channels of a picture");
        let pixels = self.pixels();
        let (r, rest) = self.data.split_at_mut(pixels);
        let (g, b) = rest.split_at_mut(pixels);
        [r, g, b]
    }

    /// The value at row `y`, column `x` of plane `c`.
    #[inline]
    pub fn at(&self, c: usize, y: usize, x: usize) -> f32 {
        self.data[(c * self.height + y) * self.width + x]
    }

    /// Sets the value at row `y`, column `x` of plane `c`.
    #[inline]
    pub fn set(&mut self, c: usize, y: usize, x: usize, value: f32) {
        self.data[(c * self.height + y) * self.width + x] = value;
    }

    /// Whether width and height are equal; channels may differ.
    pub fn same_size(&self, other: &Image) -> bool {
        self.height == other.height && self.width == other.width
    }

    /// The rectangle at (`top`, `left`) of `height` x `width` pixels.
    ///
    /// # Panics
    /// When the rectangle does not lie inside the image.
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

    /// Puts an image of the same channels in the place of the pixels from (`top`, `left`) on.
    ///
    /// # Panics
    /// When it does not fit.
    pub fn put(&mut self, top: usize, left: usize, part: &Image) {
        assert_eq!(part.channels, self.channels, "channels of the part");
        assert!(top + part.height <= self.height && left + part.width <= self.width, "the part leaves the image");
        for c in 0..self.channels {
            for y in 0..part.height {
                let to = (c * self.height + top + y) * self.width + left;
                self.data[to..to + part.width].copy_from_slice(part.row(c, y));
            }
        }
    }

    /// Overwrites the rows from `top` on with those of `rows`, which has the same channels and width.
    ///
    /// # Panics
    /// When they do not fit.
    pub fn put_rows(&mut self, top: usize, rows: &Image) {
        assert_eq!(rows.width, self.width, "width of the rows");
        self.put(top, 0, rows);
    }

    /// The mean of two images of one shape, computed so that finite values do not overflow.
    pub fn mean_of(a: &Image, b: &Image) -> Image {
        assert!(a.same_size(b) && a.channels == b.channels, "mean of images of one shape");
        Self::from_rows(a.channels, a.height, a.width, |c, y, row| {
            for ((v, a), b) in row.iter_mut().zip(a.row(c, y)).zip(b.row(c, y)) {
                *v = 0.5 * a + 0.5 * b;
            }
        })
    }
}
