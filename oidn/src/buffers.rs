//! A picture as the library takes it: interleaved, and without NaN and Inf. What is missing takes the value of its
//! neighbours, so that no hole darkens them, and is missing again in what the library returns.

use rayon::prelude::*;
use sspc_image::{HalfWeights, Image};

/// Values of a pixel.
pub(crate) const CHANNELS: usize = 3;

/// Rows of a picture, as they are read.
#[derive(Clone, Copy, Debug)]
pub struct Rows<'a> {
    /// Linear radiance, `[3, H, W]`.
    pub colour: &'a Image,
    /// Albedo, `[3, H, W]`, 0..1.
    pub albedo: Option<&'a Image>,
    /// Shading normal, `[3, H, W]`, -1..1.
    pub normal: Option<&'a Image>,
}

/// A picture to be denoised, filled row by row.
pub struct Picture {
    pub(crate) height: usize,
    pub(crate) width: usize,
    pub(crate) colour: Vec<f32>,
    pub(crate) albedo: Option<Vec<f32>>,
    pub(crate) normal: Option<Vec<f32>>,
}

impl Picture {
    /// A black picture. A normal without an albedo cannot guide the library, and is left out.
    pub fn new(height: usize, width: usize, albedo: bool, normal: bool) -> Self {
        let plane = || vec![0.0; height * width * CHANNELS];
        Self { height, width, colour: plane(), albedo: albedo.then(plane), normal: (albedo && normal).then(plane) }
    }

    /// The whole picture at once.
    ///
    /// # Panics
    /// When the images differ in size.
    pub fn of(rows: &Rows) -> Self {
        let (height, width) = (rows.colour.height(), rows.colour.width());
        let mut picture = Self::new(height, width, rows.albedo.is_some(), rows.normal.is_some());
        picture.put_rows(0, rows);
        picture
    }

    /// Fills the rows from `top` on. Features that the picture was not made with are left out.
    ///
    /// # Panics
    /// When the rows leave the picture, or lack a feature that it was made with.
    pub fn put_rows(&mut self, top: usize, rows: &Rows) {
        let from = top * self.width;
        interleave(&mut self.colour, from, Some(rows.colour));
        for (feature, rows) in [(&mut self.albedo, rows.albedo), (&mut self.normal, rows.normal)] {
            if let Some(feature) = feature {
                interleave(feature, from, rows);
            }
        }
    }

    /// Gives values to everything that is not finite; a feature that is nowhere finite is left out. Returns the pixels whose
    /// colour was missing, or `None` where no pixel has a finite colour.
    pub(crate) fn fill(&mut self) -> Option<Vec<usize>> {
        let missing = fill(&mut self.colour, self.height, self.width)?;
        let usable = |feature: &mut Option<Vec<f32>>| {
            let filled = feature.as_mut().is_some_and(|feature| fill(feature, self.height, self.width).is_some());
            if !filled {
                *feature = None;
            }
        };
        usable(&mut self.albedo);
        usable(&mut self.normal);
        if self.albedo.is_none() {
            self.normal = None;
        }
        Some(missing)
    }
}

/// The mean of two images of one shape, by pixel; where only one is finite, that one.
pub fn mean_of_finite(a: &Image, b: &Image, weights: HalfWeights) -> Image {
    let finite = |image: &Image, i: usize| (0..image.channels()).all(|c| image.plane(c)[i].is_finite());
    let mut mean = weights.mean_of(a, b);
    for i in 0..mean.pixels() {
        if (0..mean.channels()).all(|c| mean.plane(c)[i].is_finite()) {
            continue;
        }
        let only = [a, b].into_iter().find(|image| finite(image, i));
        if let Some(only) = only {
            (0..mean.channels()).for_each(|c| mean.plane_mut(c)[i] = only.plane(c)[i]);
        }
    }
    mean
}

/// Writes rows of planes over the pixels from `from` on.
fn interleave(pixels: &mut [f32], from: usize, rows: Option<&Image>) {
    let Some(rows) = rows else { panic!("rows without a feature that the picture has") };
    assert_eq!(rows.channels(), CHANNELS, "channels of the rows");
    let pixels = &mut pixels[from * CHANNELS..(from + rows.pixels()) * CHANNELS];
    let width = rows.width();
    pixels.par_chunks_exact_mut((width * CHANNELS).max(1)).enumerate().for_each(|(y, row)| {
        for c in 0..CHANNELS {
            for (x, value) in rows.row(c, y).iter().enumerate() {
                row[x * CHANNELS + c] = *value;
            }
        }
    });
}

fn is_finite(pixels: &[f32], i: usize) -> bool {
    pixels[i * CHANNELS..(i + 1) * CHANNELS].iter().all(|value| value.is_finite())
}

/// Gives pixels that are not finite the mean of their finite neighbours, ring after ring. Returns which they were; `None`
/// where there is nothing to begin with.
fn fill(pixels: &mut [f32], height: usize, width: usize) -> Option<Vec<usize>> {
    let missing: Vec<usize> = (0..height * width).filter(|&i| !is_finite(pixels, i)).collect();
    if missing.len() == height * width {
        return None;
    }
    let mut due = missing.clone();
    while !due.is_empty() {
        let mean = |&i: &usize| neighbours_mean(pixels, i, height, width).map(|mean| (i, mean));
        let ring: Vec<(usize, [f32; CHANNELS])> = due.iter().filter_map(mean).collect();
        for (i, mean) in &ring {
            pixels[i * CHANNELS..(i + 1) * CHANNELS].copy_from_slice(mean);
        }
        due = ring.iter().flat_map(|(i, _)| around(*i, height, width)).filter(|&i| !is_finite(pixels, i)).collect();
        due.sort_unstable();
        due.dedup();
    }
    Some(missing)
}

/// A pixel's eight neighbours, and itself.
fn around(i: usize, height: usize, width: usize) -> impl Iterator<Item = usize> {
    let (y, x) = (i / width, i % width);
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    (y.saturating_sub(1)..(y + 2).min(height)).flat_map(move |y| columns.clone().map(move |x| y * width + x))
}

fn neighbours_mean(pixels: &[f32], i: usize, height: usize, width: usize) -> Option<[f32; CHANNELS]> {
    let (mut sum, mut count) = ([0.0f64; CHANNELS], 0.0);
    for n in around(i, height, width).filter(|&n| is_finite(pixels, n)) {
        (0..CHANNELS).for_each(|c| sum[c] += f64::from(pixels[n * CHANNELS + c]));
        count += 1.0;
    }
    (count > 0.0).then(|| sum.map(|sum| (sum / count) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_come_interleaved_and_holes_take_their_neighbours_values() {
        let colour = Image::from_fn(3, 5, 4, |c, y, x| (100 * c + 10 * y + x) as f32);
        let mut holed = colour.clone();
        holed.set(1, 2, 1, f32::NAN);
        holed.set(0, 2, 2, f32::INFINITY);
        let mut picture = Picture::new(5, 4, false, true);
        assert!(picture.normal.is_none(), "a normal alone");
        for top in [0, 2, 4] {
            let height = 2.min(5 - top);
            let rows = holed.crop(top, 0, height, 4);
            picture.put_rows(top, &Rows { colour: &rows, albedo: None, normal: None });
        }
        assert_eq!(picture.fill(), Some(vec![9, 10]));
        for i in (0..20).filter(|i| ![9, 10].contains(i)) {
            for c in 0..3 {
                assert_eq!(picture.colour[3 * i + c], colour.plane(c)[i]);
            }
        }
        // Seven neighbours each: all around but the other hole.
        assert_eq!(picture.colour[3 * 9], (10. + 11. + 12. + 20. + 30. + 31. + 32.) / 7.0);
    }

    #[test]
    fn large_holes_grow_shut_and_what_is_nowhere_finite_is_left_out() {
        let nan = Image::filled(3, 40, 30, f32::NAN);
        let mut colour = nan.clone();
        (0..3).for_each(|c| colour.set(c, 0, 0, 7.0));
        let mut picture = Picture::of(&Rows { colour: &colour, albedo: Some(&nan), normal: Some(&colour) });
        assert_eq!(picture.fill().map(|missing| missing.len()), Some(40 * 30 - 1));
        assert!(picture.colour.iter().all(|value| *value == 7.0));
        assert!(picture.albedo.is_none() && picture.normal.is_none());
        assert_eq!(Picture::of(&Rows { colour: &nan, albedo: None, normal: None }).fill(), None);
    }

    #[test]
    fn a_pixel_that_one_half_lacks_is_the_others() {
        let (mut a, mut b) = (Image::filled(3, 2, 2, 1.0), Image::filled(3, 2, 2, 3.0));
        a.set(2, 0, 0, f32::NAN);
        b.set(0, 1, 1, f32::INFINITY);
        a.set(0, 1, 0, f32::NAN);
        b.set(1, 1, 0, f32::NAN);
        let mean = mean_of_finite(&a, &b, HalfWeights::EQUAL);
        let pixel = |i: usize| [0, 1, 2].map(|c| mean.plane(c)[i]);
        assert_eq!([pixel(0), pixel(1), pixel(3)], [[3.0; 3], [2.0; 3], [1.0; 3]]);
        assert!(!pixel(2).iter().all(|value| value.is_finite()));
    }
}
