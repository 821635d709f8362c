//! Pictures sampled along a field.
//!
//! At (X, Y) = (x + d_0, y + d_1), with X0 = floor(X) and f = X - X0, likewise in Y. A place is inside of a picture where
//! 0 ≤ X ≤ W - 1 and 0 ≤ Y ≤ H - 1; elsewhere, and where a coordinate is NaN, there is no value. Taps beyond the border
//! repeat the edge pixel.
//!
//! - bilinear: weights (1 - f, f) at X0, X0 + 1
//! - Catmull-Rom: weights (-f + 2f² - f³, 2 - 5f² + 3f³, f + 4f² - 3f³, -f² + f³) / 2 at X0 - 1 .. X0 + 2 (Catmull and Rom
//!   1974, Keys 1981 with a = -1/2)

use crate::field::Field;
use rayon::prelude::*;
use sspc_image::Image;

/// Rows that one thread warps, at a time.
pub(crate) const ROWS_PER_JOB: usize = 8;

/// A place inside of a picture.
#[derive(Clone, Copy, Debug)]
pub struct Taps {
    /// floor(X), at most W - 1.
    x: usize,
    /// floor(Y), at most H - 1.
    y: usize,
    /// Column of the second bilinear tap.
    right: usize,
    /// Row of the second bilinear tap.
    below: usize,
    fx: f32,
    fy: f32,
}

impl Taps {
    /// The place (x, y) of a picture of `height` x `width` pixels; `None` outside.
    #[inline(always)]
    pub fn at(x: f32, y: f32, height: usize, width: usize) -> Option<Self> {
        let inside = x >= 0.0 && y >= 0.0 && x <= (width - 1) as f32 && y <= (height - 1) as f32;
        if !inside {
            return None;
        }
        let (left, top) = (x as usize, y as usize);
        let (fx, fy) = (x - left as f32, y - top as f32);
        Some(Self { x: left, y: top, right: (left + 1).min(width - 1), below: (top + 1).min(height - 1), fx, fy })
    }
}

/// A plane of rows of `width` values at a place, by its four neighbours.
#[inline(always)]
pub fn bilinear(plane: &[f32], width: usize, taps: &Taps) -> f32 {
    let (top, bottom) = (&plane[taps.y * width..][..width], &plane[taps.below * width..][..width]);
    let upper = top[taps.x] * (1.0 - taps.fx) + top[taps.right] * taps.fx;
    let lower = bottom[taps.x] * (1.0 - taps.fx) + bottom[taps.right] * taps.fx;
    upper * (1.0 - taps.fy) + lower * taps.fy
}

/// Weights of Catmull-Rom at X0 - 1 .. X0 + 2.
#[inline(always)]
fn weights(f: f32) -> [f32; 4] {
    let (f2, f3) = (f * f, f * f * f);
    [0.5 * (-f + 2.0 * f2 - f3), 0.5 * (2.0 - 5.0 * f2 + 3.0 * f3), 0.5 * (f + 4.0 * f2 - 3.0 * f3), 0.5 * (f3 - f2)]
}

/// The 16 taps of a place, shared by all planes of a picture.
pub struct CubicTaps {
    across: [f32; 4],
    down: [f32; 4],
    /// First index of each row of taps, where the four lie side by side.
    starts: [usize; 4],
    /// Columns of the taps, from each row's start.
    columns: [usize; 4],
    /// Whether the four columns follow each other.
    is_inner: bool,
}

impl CubicTaps {
    /// The taps of Catmull-Rom around a place.
    #[inline(always)]
    pub fn of(taps: &Taps, height: usize, width: usize) -> Self {
        let is_inner = taps.x >= 1 && taps.x + 2 < width;
        let row = |k: usize| (taps.y + k).saturating_sub(1).min(height - 1) * width;
        let (first, columns) = match is_inner {
            true => (taps.x - 1, [0, 1, 2, 3]),
            false => (0, [0, 1, 2, 3].map(|k: usize| (taps.x + k).saturating_sub(1).min(width - 1))),
        };
        let starts = [0, 1, 2, 3].map(|k| row(k) + first);
        Self { across: weights(taps.fx), down: weights(taps.fy), starts, columns, is_inner }
    }

    /// A plane there.
    #[inline(always)]
    pub fn sample(&self, plane: &[f32]) -> f32 {
        let mut columns = [0.0f32; 4];
        for (start, down) in self.starts.iter().zip(self.down) {
            if self.is_inner {
                let four = &plane[*start..*start + 4];
                (0..4).for_each(|k| columns[k] += down * four[k]);
            } else {
                (0..4).for_each(|k| columns[k] += down * plane[start + self.columns[k]]);
            }
        }
        (columns[0] * self.across[0] + columns[1] * self.across[1])
            + (columns[2] * self.across[2] + columns[3] * self.across[3])
    }
}

/// How a picture is sampled between its pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kernel {
    /// Four taps: features.
    Bilinear,
    /// Sixteen taps, sharper: z.
    CatmullRom,
}

/// A picture along a field; NaN where the field leads outside.
///
/// # Panics
/// When field and picture differ in size.
pub fn warped(image: &Image, field: &Field, kernel: Kernel) -> Image {
    assert!(image.same_size(field), "a picture and its field");
    let (height, width) = (image.height(), image.width());
    Image::from_rows(image.channels(), height, width, |c, y, row| {
        let plane = image.plane(c);
        let (dx, dy) = (field.row(0, y), field.row(1, y));
        for (x, out) in row.iter_mut().enumerate() {
            let taps = Taps::at(x as f32 + dx[x], y as f32 + dy[x], height, width);
            *out = taps.map_or(f32::NAN, |taps| match kernel {
                Kernel::Bilinear => bilinear(plane, width, &taps),
                Kernel::CatmullRom => CubicTaps::of(&taps, height, width).sample(plane),
            });
        }
    })
}

/// Calls `of_row` with every row of some images of one size, to be changed together: row numbers, then the row of every
/// plane, on all threads.
pub(crate) fn for_rows(images: &mut [&mut Image], of_row: impl Fn(usize, &mut [&mut [f32]]) + Sync) {
    let Some(width) = images.first().map(|image| image.width()) else { return };
    let height = images[0].height();
    let mut rows: Vec<Vec<&mut [f32]>> = (0..height).map(|_| Vec::new()).collect();
    for image in images.iter_mut() {
        for plane in image.all_planes_mut() {
            plane.chunks_exact_mut(width).zip(&mut rows).for_each(|(row, rows)| rows.push(row));
        }
    }
    rows.par_iter_mut().with_min_len(ROWS_PER_JOB).enumerate().for_each(|(y, planes)| of_row(y, planes));
}
