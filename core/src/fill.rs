//! Missing pixels get a value from what is valid: the denoised value first, then the other half's,
//! then the neighbours'.

use crate::frame::Frame;
use crate::image::Image;

/// Replaces non-finite pixels of `picture` (`[3, H, W]`, the frame's units). Pixels that no source
/// can fill take the mean of the nearest filled ring of neighbours; a picture without any finite
/// pixel becomes black.
pub fn fill_missing(picture: &mut Image, frame: &Frame) {
    let pixels = picture.pixels();
    let sources = [&frame.a.denoised, &frame.b.denoised, &frame.a.radiance, &frame.b.radiance];
    let finite = |image: &Image, i: usize| (0..3).all(|k| image.plane(k)[i].is_finite());
    let mut open = Vec::new();
    for i in (0..pixels).filter(|&i| !finite(picture, i)).collect::<Vec<_>>() {
        match sources.iter().find(|source| finite(source, i)) {
            Some(source) => (0..3).for_each(|k| picture.plane_mut(k)[i] = source.plane(k)[i].max(0.0)),
            None => open.push(i),
        }
    }
    while !open.is_empty() {
        let (width, height) = (picture.width(), picture.height());
        let filled: Vec<(usize, [f32; 3])> =
            open.iter().filter_map(|&i| neighbours_mean(picture, i, height, width).map(|v| (i, v))).collect();
        if filled.is_empty() {
            open.iter().for_each(|&i| (0..3).for_each(|k| picture.plane_mut(k)[i] = 0.0));
            return;
        }
        for (i, value) in &filled {
            (0..3).for_each(|k| picture.plane_mut(k)[*i] = value[k]);
        }
        open.retain(|i| filled.binary_search_by_key(i, |f| f.0).is_err());
    }
}

fn neighbours_mean(picture: &Image, i: usize, height: usize, width: usize) -> Option<[f32; 3]> {
    let (y, x) = (i / width, i % width);
    let mut sum = [0.0f32; 3];
    let mut count = 0.0f32;
    for ny in y.saturating_sub(1)..(y + 2).min(height) {
        for nx in x.saturating_sub(1)..(x + 2).min(width) {
            let value: [f32; 3] = std::array::from_fn(|k| picture.at(k, ny, nx));
            if value.iter().all(|v| v.is_finite()) {
                (0..3).for_each(|k| sum[k] += value[k]);
                count += 1.0;
            }
        }
    }
    (count > 0.0).then(|| sum.map(|s| s / count))
}
