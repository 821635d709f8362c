//! The padded planes from which g_c's windows are read.

use crate::features::{FEATURE_CHANNELS, FeatureSet, MAX_RADIUS};
use crate::region::Region;
use crate::simd::MAX_LANES;
use rayon::prelude::*;
use sspc_image::Image;
use std::ops::Range;
use std::sync::Arc;

/// Rows that are padded by one thread at a time.
const ROWS_PER_JOB: usize = 16;

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
        let size = (features.height(), features.width());
        Self::of_rows(size, 0..features.height(), fill, valid, set, radius)
    }

    /// Windows of the pixels in `rows` of a picture of `size` (height, width), of which
    /// `fill(channel, y, row)` gives the rows, on all threads. Only the picture's borders are
    /// mirrored, and rows count from the first of `rows`.
    pub fn of_rows(
        size: (usize, usize),
        rows: Range<usize>,
        fill: impl Fn(usize, usize, &mut [f32]) + Sync,
        valid: Option<&Image>,
        set: FeatureSet,
        radius: usize,
    ) -> Self {
        let (picture_height, width) = size;
        let mut windows = Self::within(Vec::new(), rows.len(), width, valid.is_some(), set, radius);
        let padded_rows = rows.len() + 2 * radius;
        let lines = windows.data.par_chunks_exact_mut(windows.stride).with_min_len(ROWS_PER_JOB).enumerate();
        lines.for_each(|(line, padded)| {
            let (c, row) = (line / padded_rows, rows.start + line % padded_rows);
            let y = mirrored(row as isize - radius as isize, picture_height);
            let inside = &mut padded[radius..radius + width];
            match valid.filter(|_| c == FEATURE_CHANNELS) {
                Some(valid) => inside.copy_from_slice(valid.row(0, y)),
                None => fill(c, y, inside),
            }
            mirror_sides(padded, width, radius);
        });
        windows
    }

    /// Windows of the pixels of `region` of a picture of `size` (height, width), as those of the whole picture are there;
    /// pixels count from the region's first. `fill(channel, y, columns, out)` gives parts of the picture's rows, channel 13 its
    /// mask where `masked`; `buffer` is the memory of earlier windows, or empty. For small regions on many threads: each is made
    /// by one.
    ///
    /// # Panics
    /// When the region leaves the picture, or the radius exceeds [`MAX_RADIUS`].
    pub fn of_region(
        size: (usize, usize),
        Region { top, left, height, width }: Region,
        fill: impl Fn(usize, usize, Range<usize>, &mut [f32]),
        masked: bool,
        set: FeatureSet,
        radius: usize,
        buffer: Vec<f32>,
    ) -> Self {
        let (picture_height, picture_width) = size;
        assert!(top + height <= picture_height && left + width <= picture_width, "the region leaves the picture");
        let mut windows = Self::within(buffer, height, width, masked, set, radius);
        let (padded_rows, first) = (height + 2 * radius, left as isize - radius as isize);
        // Columns of a padded row that lie inside the picture.
        let inside = radius.saturating_sub(left)..(picture_width + radius - left).min(windows.stride);
        for (line, padded) in windows.data.chunks_exact_mut(windows.stride).enumerate() {
            let (c, y) = (line / padded_rows, top + line % padded_rows);
            let y = mirrored(y as isize - radius as isize, picture_height);
            let from = (first + inside.start as isize) as usize;
            fill(c, y, from..from + inside.len(), &mut padded[inside.clone()]);
            for x in (0..inside.start).chain(inside.end..padded.len()) {
                let of = mirrored(first + x as isize, picture_width);
                match of.checked_sub(from).filter(|at| *at < inside.len()) {
                    Some(at) => padded[x] = padded[inside.start + at],
                    // Beyond the window of a narrow region, where a vector still reads.
                    None => fill(c, y, of..of + 1, &mut padded[x..=x]),
                }
            }
        }
        windows
    }

    /// Windows that are still to be filled.
    fn within(mut data: Vec<f32>, height: usize, width: usize, masked: bool, set: FeatureSet, radius: usize) -> Self {
        assert!(radius <= MAX_RADIUS, "window radius {radius} above {MAX_RADIUS}");
        let stride = padded_stride(width, radius);
        let plane = (height + 2 * radius) * stride;
        data.resize((FEATURE_CHANNELS + usize::from(masked)) * plane, 0.0);
        Self { height, width, radius, stride, plane, set, data, masked }
    }

    /// Whether both have one size, radius and set of features, and masks both or none.
    pub(crate) fn is_like(&self, other: &Self) -> bool {
        let shape = |of: &Self| (of.height, of.width, of.radius, of.set, of.masked);
        shape(self) == shape(other)
    }

    /// Rows of the picture.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns of the picture.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Radius of the largest window.
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

    /// Features that take part.
    pub fn set(&self) -> FeatureSet {
        self.set
    }

    /// Whether a fourteenth plane marks missing pixels.
    pub fn masked(&self) -> bool {
        self.masked
    }

    /// All padded planes.
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// The memory, to be used for other windows.
    pub fn into_data(self) -> Vec<f32> {
        self.data
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

/// Further planes of a picture, padded and mirrored as [`Windows`] are.
#[derive(Clone, Debug)]
pub struct PaddedPlanes {
    height: usize,
    width: usize,
    radius: usize,
    stride: usize,
    count: usize,
    data: Vec<f32>,
}

impl PaddedPlanes {
    /// `count` planes of the pixels in `rows` of a picture of `size` (height, width), of which `fill(plane, y, row)` gives
    /// the rows, on all threads; padded by `radius`, at most [`MAX_RADIUS`]. Rows count from the first of `rows`.
    pub fn of_rows(
        size: (usize, usize),
        rows: Range<usize>,
        count: usize,
        fill: impl Fn(usize, usize, &mut [f32]) + Sync,
        radius: usize,
    ) -> Self {
        let (picture_height, width) = size;
        let stride = padded_stride(width, radius);
        let padded_rows = rows.len() + 2 * radius;
        let mut data = vec![0.0; count * padded_rows * stride];
        let lines = data.par_chunks_exact_mut(stride).with_min_len(ROWS_PER_JOB).enumerate();
        lines.for_each(|(line, padded)| {
            let (c, row) = (line / padded_rows, rows.start + line % padded_rows);
            fill(c, mirrored(row as isize - radius as isize, picture_height), &mut padded[radius..radius + width]);
            mirror_sides(padded, width, radius);
        });
        Self { height: rows.len(), width, radius, stride, count, data }
    }

    /// Number of planes.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Rows of the picture.
    pub fn height(&self) -> usize {
        self.height
    }

    /// Columns of the picture.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Pixels that the planes are padded by on each side.
    pub fn radius(&self) -> usize {
        self.radius
    }

    /// Plane `c` from a pixel on, which may lie up to `radius` outside the picture; beyond the row there are others.
    pub fn row(&self, c: usize, y: isize, x: isize) -> &[f32] {
        let r = self.radius as isize;
        let line = c * (self.height + 2 * self.radius) + (y + r) as usize;
        &self.data[line * self.stride + (x + r) as usize..]
    }
}

/// A picture's features, shared, from which the windows of any tile are made when they are needed:
/// padded planes of the whole picture would hold the features a second time.
#[derive(Clone, Debug)]
pub struct FeaturePlanes {
    features: Arc<Image>,
    valid: Option<Arc<Image>>,
    set: FeatureSet,
    radius: usize,
}

impl FeaturePlanes {
    /// Features `[13, H, W]` and the mask of missing pixels, as of [`Windows::new`].
    ///
    /// # Panics
    /// When the features have other channels.
    pub fn new(features: Arc<Image>, valid: Option<Arc<Image>>, set: FeatureSet, radius: usize) -> Self {
        assert_eq!(features.channels(), FEATURE_CHANNELS, "feature channels");
        Self { features, valid, set, radius }
    }

    /// The features, `[13, H, W]`.
    pub fn features(&self) -> &Image {
        &self.features
    }

    /// The windows of the pixels of `region`; pixels count from the region's first. `buffer` is the
    /// memory of earlier windows, or empty.
    pub fn windows(&self, region: Region, buffer: Vec<f32>) -> Windows {
        let (features, valid) = (&self.features, self.valid.as_deref());
        let fill = |c: usize, y: usize, columns: Range<usize>, out: &mut [f32]| {
            let row = match valid.filter(|_| c == FEATURE_CHANNELS) {
                Some(valid) => valid.row(0, y),
                None => features.row(c, y),
            };
            out.copy_from_slice(&row[columns]);
        };
        let size = (features.height(), features.width());
        Windows::of_region(size, region, fill, valid.is_some(), self.set, self.radius, buffer)
    }
}

/// Floats of a padded row: a vector that starts at the last pixel and looks `radius` to the right stays inside.
fn padded_stride(width: usize, radius: usize) -> usize {
    width + 2 * radius + MAX_LANES
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
    use super::*;
    use fastrand::Rng;

    /// Fails when a tile's windows differ anywhere from the picture's: at borders, beside them, inside.
    #[test]
    fn windows_of_a_region_are_those_of_the_picture() {
        let mut rng = Rng::with_seed(4);
        for (height, width, radius) in [(1, 1, 3), (9, 5, 7), (30, 41, 2), (20, 70, 9)] {
            let features = Image::from_fn(FEATURE_CHANNELS, height, width, |_, _, _| rng.f32());
            let valid = Image::from_fn(1, height, width, |_, _, _| f32::from(rng.f32() > 0.2));
            let whole = Windows::new(&features, Some(&valid), FeatureSet::ALL, radius);
            let planes =
                FeaturePlanes::new(Arc::new(features.clone()), Some(Arc::new(valid.clone())), FeatureSet::ALL, radius);
            let (top, left) = (height / 3, width / 3);
            let inner = Region { top, left, height: height - top, width: (width - left).div_ceil(2) };
            let rows = Region { left: 0, width, ..inner };
            let fill = |c: usize, y: usize, row: &mut [f32]| row.copy_from_slice(features.row(c, y));
            let size = (height, width);
            let band = Windows::of_rows(size, top..height, fill, Some(&valid), FeatureSet::ALL, radius);
            let all = Region { top: 0, left: 0, height, width };
            for (part, region) in
                [(planes.windows(inner, vec![7.0; 99]), inner), (planes.windows(all, Vec::new()), all), (band, rows)]
            {
                assert_eq!((part.height(), part.width(), part.masked()), (region.height, region.width, true));
                for c in 0..=FEATURE_CHANNELS {
                    for y in 0..region.height + 2 * radius {
                        let found = &part.data()[c * part.plane() + y * part.stride()..][..part.stride()];
                        let from = c * whole.plane() + (region.top + y) * whole.stride() + region.left;
                        assert_eq!(found, &whole.data()[from..][..part.stride()], "channel {c}, row {y}, {region:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn mirrored_indices_repeat_the_edges() {
        assert_eq!((0..8).map(|i| mirrored(i, 3)).collect::<Vec<_>>(), [0, 1, 2, 2, 1, 0, 0, 1]);
        assert_eq!((-4..0).map(|i| mirrored(i, 3)).collect::<Vec<_>>(), [2, 2, 1, 0]);
        assert_eq!((-1..2).map(|i| mirrored(i, 1)).collect::<Vec<_>>(), [0, 0, 0]);
    }
}
