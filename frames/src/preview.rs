//! Pictures for the eye: a tone curve, error colours, PNG.

use crate::atomic::atomic_write;
use crate::error::Error;
use sspc_image::{Image, display};
use std::io;
use std::path::{Path, PathBuf};

/// Error that gets the darkest colour of [`error_map`].
pub const ERROR_MAP_LOW: f32 = 1e-4;
/// Error that gets the brightest colour of [`error_map`].
pub const ERROR_MAP_HIGH: f32 = 1.0;
/// What a missing (non-finite) pixel looks like in every preview.
pub const MISSING: [u8; 3] = [255, 0, 255];
/// Mid-grey that [`auto_exposure`] aims at.
const KEY: f64 = 0.18;
/// Pixels between the pictures of a strip.
const GAP: usize = 4;

/// 8-bit sRGB, interleaved, rows from top to bottom.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rgb8 {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// `3 * width * height` bytes.
    pub data: Vec<u8>,
}

/// An exposure that puts the geometric mean of the positive luminances at mid-grey (Reinhard et al. 2002, without
/// their curve). 1 for a picture without light.
pub fn auto_exposure(image: &Image) -> f32 {
    let (mut sum, mut count) = (0.0f64, 0u64);
    for i in 0..image.pixels() {
        let y = luminance(image, i);
        if y.is_finite() && y > 0.0 {
            sum += f64::from(y).ln();
            count += 1;
        }
    }
    if count == 0 { 1.0 } else { (KEY / (sum / count as f64).exp()) as f32 }
}

/// Rec. 709 luminance of pixel `i` of a `[3, H, W]` image.
fn luminance(image: &Image, i: usize) -> f32 {
    0.2126 * image.plane(0)[i] + 0.7152 * image.plane(1)[i] + 0.0722 * image.plane(2)[i]
}

/// A `[3, H, W]` image through [`display`]; non-finite pixels become [`MISSING`].
pub fn tone_map(image: &Image, exposure: f32) -> Rgb8 {
    let mut data = Vec::with_capacity(3 * image.pixels());
    for i in 0..image.pixels() {
        let rgb = [0, 1, 2].map(|c| display(image.plane(c)[i], exposure));
        match rgb.iter().all(|value| value.is_finite()) {
            true => data.extend(rgb.map(quantise)),
            false => data.extend(MISSING),
        }
    }
    Rgb8 { width: image.width(), height: image.height(), data }
}

/// The places of a picture `[3, H, W]` where `places` `[1, H, W]` is 1, the rest dimmed; through [`tone_map`].
pub fn spotlight(image: &Image, places: &Image, exposure: f32) -> Rgb8 {
    let lit = |c, y, x| image.at(c, y, x) * (0.1 + 0.9 * places.at(0, y, x));
    tone_map(&Image::from_fn(3, image.height(), image.width(), lit), exposure)
}

/// Errors `[1, H, W]` (relL2 of each pixel) in colours from black through
/// violet, red and orange to pale yellow: the logarithm from [`ERROR_MAP_LOW`] to [`ERROR_MAP_HIGH`] is the position on
/// [`magma`]. Missing pixels become [`MISSING`].
pub fn error_map(errors: &Image) -> Rgb8 {
    let span = (ERROR_MAP_HIGH / ERROR_MAP_LOW).ln();
    let colours = errors.data().iter().flat_map(|&error| match error.is_finite() {
        true => magma((error.max(ERROR_MAP_LOW) / ERROR_MAP_LOW).ln() / span),
        false => MISSING,
    });
    Rgb8 { width: errors.width(), height: errors.height(), data: colours.collect() }
}

/// Shares `[1, H, W]`, 0..`largest`, in the colours of [`magma`]: black where nothing was used. Missing pixels become
/// [`MISSING`].
pub fn share_map(shares: &Image, largest: f32) -> Rgb8 {
    let colour = |share: f32| if share.is_finite() { magma(share / largest) } else { MISSING };
    let colours = shares.data().iter().flat_map(|&share| colour(share));
    Rgb8 { width: shares.width(), height: shares.height(), data: colours.collect() }
}

/// A point on the colour map "magma" (S. van der Walt and N. Smith, 2015, public domain), interpolated between nine of
/// its colours: luminance rises evenly from black to pale yellow. `position` is clamped to 0..1.
pub fn magma(position: f32) -> [u8; 3] {
    const COLOURS: [[u8; 3]; 9] = [
        [0, 0, 4],
        [28, 16, 68],
        [79, 18, 123],
        [129, 37, 129],
        [181, 54, 122],
        [229, 80, 100],
        [251, 135, 97],
        [254, 194, 135],
        [252, 253, 191],
    ];
    let at = position.clamp(0.0, 1.0) * (COLOURS.len() - 1) as f32;
    let below = (at as usize).min(COLOURS.len() - 2);
    let (low, high, t) = (COLOURS[below], COLOURS[below + 1], at - below as f32);
    [0, 1, 2].map(|c| quantise((f32::from(low[c]) * (1.0 - t) + f32::from(high[c]) * t) / 255.0))
}

fn quantise(value: f32) -> u8 {
    (value.clamp(0.0, 1.0) * 255.0).round() as u8
}

/// Pictures of one height side by side, with a white gap.
///
/// # Panics
/// When the heights differ.
pub fn strip(pictures: &[Rgb8]) -> Rgb8 {
    let height = pictures.first().map_or(0, |picture| picture.height);
    assert!(pictures.iter().all(|picture| picture.height == height), "a strip of pictures of one height");
    let gaps = GAP * pictures.len().saturating_sub(1);
    let width = pictures.iter().map(|picture| picture.width).sum::<usize>() + gaps;
    let mut data = Vec::with_capacity(3 * width * height);
    for y in 0..height {
        for (i, picture) in pictures.iter().enumerate() {
            if i > 0 {
                data.extend([255; 3 * GAP]);
            }
            data.extend(&picture.data[3 * y * picture.width..3 * (y + 1) * picture.width]);
        }
    }
    Rgb8 { width, height, data }
}

/// Writes an sRGB PNG as [`atomic_write`] does.
///
/// # Errors
/// As [`atomic_write`].
pub fn write_png(path: &Path, inputs: &[PathBuf], picture: &Rgb8) -> Result<(), Error> {
    atomic_write(path, inputs, |out| {
        let mut encoder = png::Encoder::new(out, picture.width as u32, picture.height as u32);
        encoder.set_color(png::ColorType::Rgb);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
        encoder.set_compression(png::Compression::Fast);
        let mut writer = encoder.write_header().map_err(io::Error::other)?;
        writer.write_image_data(&picture.data).map_err(io::Error::other)?;
        writer.finish().map_err(io::Error::other)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_curve_has_the_standards_values() {
        // sRGB of 18 % grey is 0.4613561 (IEC 61966-2-1).
        assert!((display(0.18, 1.0) - 0.461_356_1).abs() < 1e-6);
        assert_eq!(display(-1.0, 1.0), 0.0);
        assert!((display(50.0, 1.0) - 1.0).abs() < 1e-6);
        assert!(display(f32::NAN, 1.0).is_nan());
    }

    #[test]
    fn error_colours_run_from_black_to_pale_yellow_with_rising_luminance() {
        assert_eq!(magma(-1.0), [0, 0, 4]);
        assert_eq!(magma(0.5), [181, 54, 122]);
        assert_eq!(magma(2.0), [252, 253, 191]);
        let luminance = |[r, g, b]: [u8; 3]| 0.2126 * f32::from(r) + 0.7152 * f32::from(g) + 0.0722 * f32::from(b);
        for i in 0..64 {
            let (low, high) = (magma(i as f32 / 64.0), magma((i + 1) as f32 / 64.0));
            // One level of slack for rounding of three channels.
            assert!(luminance(high) + 1.0 > luminance(low), "at {i}");
        }
    }

    #[test]
    fn a_strip_puts_pictures_beside_each_other() {
        let one = Rgb8 { width: 1, height: 2, data: vec![1, 2, 3, 4, 5, 6] };
        let both = strip(&[one.clone(), one]);
        assert_eq!((both.width, both.height), (2 + GAP, 2));
        assert_eq!(&both.data[..3], &[1, 2, 3]);
        assert_eq!(&both.data[both.data.len() - 3..], &[4, 5, 6]);
    }

    #[test]
    fn exposure_puts_the_geometric_mean_at_mid_grey_and_missing_pixels_stand_out() {
        let image = Image::from_fn(3, 1, 3, |_, _, x| [2.0, 8.0, f32::NAN][x]);
        assert!((auto_exposure(&image) - 0.18 / 4.0).abs() < 1e-6);
        assert_eq!(tone_map(&image, 1.0).data[6..], MISSING);
        assert_eq!(auto_exposure(&Image::zeros(3, 2, 2)), 1.0);
    }
}
