//! Channel order of the features that the network reads and g_c compares, and the padded planes
//! from which g_c's windows are read. The one owner of both.

use crate::image::Image;
use crate::simd::MAX_LANES;
use rayon::prelude::*;

/// y(3) ρ(3) v(1) n(3) z(3).
pub const FEATURE_CHANNELS: usize = 13;
/// First channel of the noisy radiance y.
pub const RADIANCE: usize = 0;
/// First channel of the albedo ρ.
pub const ALBEDO: usize = 3;
/// The visibility v.
pub const VISIBILITY: usize = 6;
/// First channel of the normal n.
pub const NORMAL: usize = 7;
/// First channel of the denoised radiance z.
pub const DENOISED: usize = 10;

/// Names of the channels, in order, as the model contract states them.
pub const CHANNEL_NAMES: [&str; FEATURE_CHANNELS] = [
    "radiance.R",
    "radiance.G",
    "radiance.B",
    "albedo.R",
    "albedo.G",
    "albedo.B",
    "visibility",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "denoised.R",
    "denoised.G",
    "denoised.B",
];

/// Which optional features take part. One that is absent, or the same at every pixel, is all
/// zeros, its differences vanish, and the kernels skip it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct FeatureSet {
    pub albedo: bool,
    pub normal: bool,
    pub visibility: bool,
}

impl FeatureSet {
    pub const ALL: FeatureSet = FeatureSet { albedo: true, normal: true, visibility: true };
    pub const NONE: FeatureSet = FeatureSet { albedo: false, normal: false, visibility: false };

    /// Features of this one that the other has not.
    pub fn without(self, other: FeatureSet) -> FeatureSet {
        FeatureSet {
            albedo: self.albedo && !other.albedo,
            normal: self.normal && !other.normal,
            visibility: self.visibility && !other.visibility,
        }
    }

    /// Features of either.
    pub fn union(self, other: FeatureSet) -> FeatureSet {
        FeatureSet {
            albedo: self.albedo || other.albedo,
            normal: self.normal || other.normal,
            visibility: self.visibility || other.visibility,
        }
    }
}

/// Radius of the largest window Ω_c that [`Windows`] can serve: 25 x 25 pixels.
pub const MAX_RADIUS: usize = 12;

/// Rows that are padded by one thread at a time.
const ROWS_A_JOB: usize = 16;

/// The 13 feature planes of a picture with mirrored borders (the edge pixel repeated), from which
/// every window Ω_c can be read without a bounds check, and the mask of missing pixels.
#[derive(Clone, Debug)]
pub struct Windows {
    height: usize,
    width: usize,
    radius: usize,
    stride: usize,
    plane: usize,
    set: FeatureSet,
    /// 13 planes, then the mask's plane when there is one.
    data: Vec<f32>,
    masked: bool,
}

impl Windows {
    /// Windows of `radius` over features `[13, H, W]`; `valid` is 1 where a pixel counts and 0
    /// where it is missing, `[1, H, W]`.
    ///
    /// # Panics
    /// When the features have other channels, or the radius exceeds [`MAX_RADIUS`].
    pub fn new(features: &Image, valid: Option<&Image>, set: FeatureSet, radius: usize) -> Self {
        assert_eq!(features.channels(), FEATURE_CHANNELS, "feature channels");
        let fill = |c: usize, y: usize, row: &mut [f32]| row.copy_from_slice(features.row(c, y));
        Self::from_rows(features.height(), features.width(), fill, valid, set, radius)
    }

    /// The same of a picture of which `fill(channel, y, row)` gives the rows, on all threads.
    pub fn from_rows(
        height: usize,
        width: usize,
        fill: impl Fn(usize, usize, &mut [f32]) + Sync,
        valid: Option<&Image>,
        set: FeatureSet,
        radius: usize,
    ) -> Self {
        assert!(radius <= MAX_RADIUS, "window radius {radius} above {MAX_RADIUS}");
        // A vector that starts at the last pixel and looks `radius` to the right stays inside.
        let stride = width + 2 * radius + MAX_LANES;
        let rows = height + 2 * radius;
        let plane = rows * stride;
        let planes = FEATURE_CHANNELS + usize::from(valid.is_some());
        let mut data = vec![0.0; planes * plane];
        data.par_chunks_exact_mut(stride).with_min_len(ROWS_A_JOB).enumerate().for_each(|(row, padded)| {
            let (c, y) = (row / rows, mirrored((row % rows) as isize - radius as isize, height));
            let inside = &mut padded[radius..radius + width];
            match valid.filter(|_| c == FEATURE_CHANNELS) {
                Some(valid) => inside.copy_from_slice(valid.row(0, y)),
                None => fill(c, y, inside),
            }
            mirror_sides(padded, width, radius);
        });
        Self { height, width, radius, stride, plane, set, data, masked: valid.is_some() }
    }

    pub fn height(&self) -> usize {
        self.height
    }

    pub fn width(&self) -> usize {
        self.width
    }

    pub fn radius(&self) -> usize {
        self.radius
    }

    /// Floats from one row to the next.
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Floats from one plane to the next.
    pub fn plane(&self) -> usize {
        self.plane
    }

    pub fn set(&self) -> FeatureSet {
        self.set
    }

    /// Whether a fourteenth plane marks missing pixels.
    pub fn masked(&self) -> bool {
        self.masked
    }

    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// Where pixel (y, x) lies in a plane.
    pub fn offset(&self, y: usize, x: usize) -> usize {
        (y + self.radius) * self.stride + x + self.radius
    }

    /// Feature `c` at a pixel that may lie up to `radius` outside the picture.
    pub fn at(&self, c: usize, y: isize, x: isize) -> f32 {
        let r = self.radius as isize;
        self.data[c * self.plane + (y + r) as usize * self.stride + (x + r) as usize]
    }
}

/// Index of the pixel that stands at `i` when `0..n` is mirrored with its edge pixels repeated.
pub fn mirrored(i: isize, n: usize) -> usize {
    let n = n as isize;
    let m = i.rem_euclid(2 * n);
    (if m < n { m } else { 2 * n - 1 - m }) as usize
}

/// Completes a padded row whose pixels `radius..radius + width` are there.
fn mirror_sides(row: &mut [f32], width: usize, radius: usize) {
    for x in (0..radius).chain(radius + width..row.len()) {
        row[x] = row[radius + mirrored(x as isize - radius as isize, width)];
    }
}

#[cfg(test)]
mod tests {
    use super::mirrored;

    #[test]
    fn mirrored_indices_repeat_the_edges() {
        assert_eq!((0..8).map(|i| mirrored(i, 3)).collect::<Vec<_>>(), [0, 1, 2, 2, 1, 0, 0, 1]);
        assert_eq!((-4..0).map(|i| mirrored(i, 3)).collect::<Vec<_>>(), [2, 2, 1, 0]);
        assert_eq!((-1..2).map(|i| mirrored(i, 1)).collect::<Vec<_>>(), [0, 0, 0]);
    }
}
