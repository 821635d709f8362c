//! Motion estimated from pictures of one half, where the renderer gives none.
//!
//! Albedo, normal and the logarithm of z's brightness of the frame are matched with those of the neighbour, coarse to fine:
//! blocks by the sum of absolute differences (`blocks`), the finest to parts of a pixel by Gauss-Newton steps (Lucas and
//! Kanade 1981, in the inverse form of Baker and Matthews 2004), and every pixel takes the mean of the blocks around it,
//! weighted by how well each fits there (Kroeger et al. 2016). Nothing but the half's own pictures is looked at, so the
//! field is independent of the other half's noise.

mod blocks;
mod dense;
mod pyramid;
mod subpixel;

use crate::field::Field;
use crate::validity::{ALBEDO_WEIGHT, Guides, NORMAL_WEIGHT};
use pyramid::{Level, pyramid};
use sspc_image::Image;

/// Weight of the brightness's logarithm (base e) beside the features.
const BRIGHTNESS: f32 = 0.5;
/// Weight of the logarithm of each channel where there are no features.
const COLOUR: f32 = 1.2;

/// The finest level whose blocks are matched: half the picture's size. The picture's own size takes four times as long, for a few hundredths of a pixel.
const FINEST: usize = 1;

/// Pictures of one half of a frame, made ready for matching.
pub struct Matchable {
    /// From the finest level on.
    levels: Vec<Level>,
}

impl Matchable {
    /// Makes z `[3, H, W]` and the features of a half ready.
    pub fn of(denoised: &Image, guides: &Guides) -> Self {
        Self { levels: pyramid(planes(denoised, guides, brightness(denoised))) }
    }
}

/// The mean of a picture's brightness where it is finite and positive, 1 without any.
pub(crate) fn brightness(picture: &Image) -> f32 {
    let bright = |i: usize| (0..3).map(|c| f64::from(picture.plane(c)[i])).sum::<f64>() / 3.0;
    let values = (0..picture.pixels()).map(bright).filter(|value| value.is_finite() && *value > 0.0);
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    let mean = (sum / f64::max(count, 1.0)) as f32;
    if mean > 0.0 && mean.is_finite() { mean } else { 1.0 }
}

/// What is matched: the brightness's logarithm, albedo's mean, the normal's first two components, scaled as in the validity;
/// without features, the channels' logarithms. Values that are not finite become 0.
fn planes(denoised: &Image, guides: &Guides, brightness: f32) -> Image {
    let logarithm = |value: f32| (0.1 + value.max(0.0) / brightness).ln();
    let finite = |value: f32| if value.is_finite() { value } else { 0.0 };
    if guides.albedo.is_none() && guides.normal.is_none() {
        return Image::from_rows(3, denoised.height(), denoised.width(), |c, y, row| {
            row.iter_mut().zip(denoised.row(c, y)).for_each(|(out, z)| *out = finite(COLOUR * logarithm(*z)));
        });
    }
    let albedo = guides.albedo.map(|albedo| (albedo, ALBEDO_WEIGHT.sqrt() * 3f32.sqrt() / 3.0));
    let normal = guides.normal.map(|normal| (normal, NORMAL_WEIGHT.sqrt()));
    let channels = 1 + usize::from(albedo.is_some()) + 2 * usize::from(normal.is_some());
    Image::from_rows(channels, denoised.height(), denoised.width(), |c, y, row| {
        match (c, albedo, normal) {
            (0, ..) => {
                let [r, g, b] = [0, 1, 2].map(|c| denoised.row(c, y));
                for (x, out) in row.iter_mut().enumerate() {
                    let mean = (r[x].max(0.0) + g[x].max(0.0) + b[x].max(0.0)) / 3.0;
                    *out = BRIGHTNESS * logarithm(mean);
                }
            }
            (1, Some((albedo, scale)), _) => {
                let [r, g, b] = [0, 1, 2].map(|c| albedo.row(c, y));
                row.iter_mut().enumerate().for_each(|(x, out)| *out = scale * (r[x] + g[x] + b[x]));
            }
            (_, _, Some((normal, scale))) => {
                let source = normal.row(c - (channels - 2), y);
                row.iter_mut().zip(source).for_each(|(out, value)| *out = scale * value);
            }
            _ => {}
        }
        row.iter_mut().for_each(|value| *value = finite(*value));
    })
}

/// Where the pixels of a frame lie in its neighbour.
///
/// # Panics
/// When both differ in size or features.
pub fn estimated(centre: &Matchable, neighbour: &Matchable) -> Field {
    let pairs: Vec<(&Level, &Level)> = centre.levels.iter().zip(&neighbour.levels).collect();
    let alike = |(own, other): &(&Level, &Level)| own.is_like(other);
    assert!(centre.levels.len() == neighbour.levels.len() && pairs.iter().all(alike), "pictures of one size");
    let finest = FINEST.min(pairs.len() - 1);
    let mut found = None;
    for (own, other) in pairs[finest..].iter().rev() {
        found = Some(blocks::matched(own, other, found.as_ref()));
    }
    let (own, other) = pairs[finest];
    let refined = found.map(|found| subpixel::refined(own, other, &found).smoothed());
    let (own, other) = pairs[0];
    match refined {
        Some(refined) => dense::field(own, other, &refined, finest),
        None => crate::field::still(own.height(), own.width()),
    }
}
