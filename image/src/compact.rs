//! Images that are kept in 16 bits a value until their rows are asked for.

use crate::Image;
use half::f16;
use half::slice::HalfFloatSliceExt;
use std::ops::Range;

/// Exponent of the largest value as it is kept: half floats are full up to 2^16, and down to 2^-14 they are normal.
const LARGEST: i32 = 14;
/// Exponents of the factor: beyond these it would leave f32 itself.
const FACTORS: Range<i32> = -126..114;

/// A planar image of half floats times a power of two, so that neither 1e-6 nor 1e6 leaves their range: every value keeps
/// 11 bits, as in a file of half floats, down to 2^-28 of the largest. What is not finite is kept as NaN.
#[derive(Clone, Debug, PartialEq)]
pub struct CompactImage {
    channels: usize,
    height: usize,
    width: usize,
    /// A value as kept, times this, is the value.
    factor: f32,
    data: Vec<f16>,
}

impl CompactImage {
    /// Keeps the image.
    pub fn of(image: &Image) -> Self {
        let (channels, height, width) = (image.channels(), image.height(), image.width());
        Self { channels, height, width, ..Self::keep(image.data(), image.data().iter()) }
    }

    /// Keeps `height` rows of pixels, whose `channels` values stand together.
    ///
    /// # Panics
    /// When there is another number of values.
    pub fn of_interleaved(channels: usize, height: usize, width: usize, values: &[f32]) -> Self {
        assert_eq!(values.len(), channels * height * width, "interleaved samples of {channels}x{height}x{width}");
        let planar = (0..channels).flat_map(|c| values.iter().skip(c).step_by(channels));
        Self { channels, height, width, ..Self::keep(values, planar) }
    }

    /// Values, in any order, and in that of planes.
    fn keep<'a>(values: &[f32], planar: impl Iterator<Item = &'a f32>) -> Self {
        let finite = values.iter().filter(|value| value.is_finite());
        let largest = finite.fold(0.0f32, |largest, value| largest.max(value.abs()));
        let exponent = if largest > 0.0 { largest.log2().floor() as i32 - LARGEST } else { 0 };
        let factor = f32::exp2(exponent.clamp(FACTORS.start, FACTORS.end - 1) as f32);
        let kept = |value: &f32| if value.is_finite() { f16::from_f32(value / factor) } else { f16::NAN };
        let mut data = Vec::with_capacity(values.len());
        data.extend(planar.map(kept));
        Self { channels: 1, height: 1, width: data.len(), factor, data }
    }

    /// Number of planes.
    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Some rows of it.
    ///
    /// # Panics
    /// When the rows leave the image.
    pub fn rows(&self, rows: Range<usize>) -> Image {
        assert!(rows.start <= rows.end && rows.end <= self.height, "rows {rows:?} of {}", self.height);
        Image::from_rows(self.channels, rows.len(), self.width, |c, y, row| {
            let start = (c * self.height + rows.start + y) * self.width;
            self.data[start..start + self.width].convert_to_f32_slice(row);
            row.iter_mut().for_each(|value| *value *= self.factor);
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_keep_eleven_bits_whatever_their_scale() {
        for scale in [1e-30f32, 1e-6, 1.0, 65504.0, 1e30] {
            let image = Image::from_fn(3, 5, 7, |c, y, x| scale / (1.0 + (c * 35 + y * 7 + x) as f32).powi(3));
            let kept = CompactImage::of(&image);
            assert_eq!((kept.channels(), kept.height(), kept.width()), (3, 5, 7));
            for (a, b) in kept.rows(0..5).data().iter().zip(image.data()) {
                assert!((a - b).abs() <= b * f32::exp2(-11.0), "{a} for {b}");
            }
            let interleaved: Vec<f32> =
                (0..35).flat_map(|i| (0..3).map(move |c| (c, i))).map(|(c, i)| image.plane(c)[i]).collect();
            assert_eq!(CompactImage::of_interleaved(3, 5, 7, &interleaved), kept);
            assert_eq!(kept.rows(2..4), kept.rows(0..5).crop(2, 0, 2, 7));
        }
    }

    #[test]
    fn half_floats_stay_as_they_are_and_what_is_missing_stays_missing() {
        let mut image = Image::from_fn(1, 4, 4, |_, y, x| f16::from_f32(1.7f32.powi((4 * y + x) as i32)).to_f32());
        image.set(0, 1, 1, f32::INFINITY);
        image.set(0, 2, 1, 0.0);
        let back = CompactImage::of(&image).rows(0..4);
        for (a, b) in back.data().iter().zip(image.data()) {
            assert!(a == b || (a.is_nan() && !b.is_finite()), "{a} for {b}");
        }
        let black = Image::zeros(3, 1, 1);
        assert_eq!(CompactImage::of(&black).rows(0..1), black);
    }
}
