//! Missing pixels get a value from what is valid: the denoised value first, then the other half's,
//! then the neighbours'.

use sspc_image::{Frame, Image};

/// Values of the non-finite pixels of `picture`, by their index: those of the first image of the frame that is finite
/// there; pixels without one are left out.
pub fn values_from_sources(picture: &Image, frame: &Frame) -> Vec<(usize, [f32; 3])> {
    let sources = [&frame.a.denoised, &frame.b.denoised, &frame.a.radiance, &frame.b.radiance];
    let value = |i: usize| {
        let source = sources.iter().find(|source| finite(source, i))?;
        Some((i, std::array::from_fn(|k| source.plane(k)[i])))
    };
    (0..picture.pixels()).filter(|&i| !finite(picture, i)).filter_map(value).collect()
}

/// Puts values where they belong.
pub fn put(picture: &mut Image, values: &[(usize, [f32; 3])]) {
    values.iter().for_each(|(i, value)| set(picture, *i, *value));
}

/// Gives pixels that are still not finite the mean of the nearest filled ring of neighbours; a
/// picture without any finite pixel becomes black.
pub fn grow_shut(picture: &mut Image) {
    let (width, height) = (picture.width(), picture.height());
    let mut due: Vec<usize> = (0..picture.pixels()).filter(|&i| !finite(picture, i)).collect();
    // Ring after ring; each looks only at the neighbours of the last one.
    while !due.is_empty() {
        let filled: Vec<(usize, [f32; 3])> =
            due.iter().filter_map(|&i| neighbours_mean(picture, i, height, width).map(|v| (i, v))).collect();
        if filled.is_empty() {
            due.iter().for_each(|&i| set(picture, i, [0.0; 3]));
            return;
        }
        put(picture, &filled);
        due = filled.iter().flat_map(|f| around(f.0, height, width)).filter(|&i| !finite(picture, i)).collect();
        due.sort_unstable();
        due.dedup();
    }
}

fn finite(image: &Image, i: usize) -> bool {
    (0..3).all(|k| image.plane(k)[i].is_finite())
}

fn set(picture: &mut Image, i: usize, value: [f32; 3]) {
    (0..3).for_each(|k| picture.plane_mut(k)[i] = value[k]);
}

/// A pixel's eight neighbours, and itself.
fn around(i: usize, height: usize, width: usize) -> impl Iterator<Item = usize> {
    let (y, x) = (i / width, i % width);
    let columns = x.saturating_sub(1)..(x + 2).min(width);
    (y.saturating_sub(1)..(y + 2).min(height)).flat_map(move |y| columns.clone().map(move |x| y * width + x))
}

fn neighbours_mean(picture: &Image, i: usize, height: usize, width: usize) -> Option<[f32; 3]> {
    let mut sum = [0.0f32; 3];
    let mut count = 0.0f32;
    for n in around(i, height, width).filter(|&n| finite(picture, n)) {
        (0..3).for_each(|k| sum[k] += picture.plane(k)[n]);
        count += 1.0;
    }
    (count > 0.0).then(|| sum.map(|s| s / count))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sspc_image::HalfBuffer;

    fn fill_missing(picture: &mut Image, frame: &Frame) {
        let values = values_from_sources(picture, frame);
        put(picture, &values);
        grow_shut(picture);
    }

    fn frame(radiance: Image, denoised: Image) -> Frame {
        let half = HalfBuffer { radiance, denoised, albedo: None, normal: None, visibility: None };
        Frame::of_halves(half.clone(), half)
    }

    #[test]
    fn holes_take_the_denoised_value_and_else_grow_shut() {
        let mut z = Image::filled(3, 9, 11, 2.0);
        let y = z.clone();
        (0..3).for_each(|k| z.set(k, 4, 4, 7.0));
        let mut picture = Image::filled(3, 9, 11, 2.0);
        picture.set(1, 4, 4, f32::NAN);
        fill_missing(&mut picture, &frame(y, z));
        assert_eq!(picture.at(1, 4, 4), 7.0);

        let nothing = Image::filled(3, 9, 11, f32::NAN);
        let mut picture = nothing.clone();
        (0..3).for_each(|k| picture.set(k, 0, 0, 3.0));
        fill_missing(&mut picture, &frame(nothing.clone(), nothing.clone()));
        assert!(picture.data().iter().all(|v| *v == 3.0));

        let mut picture = nothing.clone();
        fill_missing(&mut picture, &frame(nothing.clone(), nothing));
        assert!(picture.data().iter().all(|v| *v == 0.0));
    }
}
