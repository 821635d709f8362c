//! Displacements: where a pixel lies in another frame.

use crate::warp::{Taps, bilinear};
use sspc_image::Image;

/// Displacements `[2, H, W]`: pixel (x, y) lies at (x + d_0, y + d_1) of another frame, pixels, x to the right, y down.
pub type Field = Image;

/// Beyond this difference, pixels, two fields of a pixel are of different things, and their mean is of neither.
const SAME_THING: f32 = 1.0;

/// The field that leaves everything where it is.
pub fn still(height: usize, width: usize) -> Field {
    Image::zeros(2, height, width)
}

/// From a frame to the one after next: `first` followed by `second`, which is read where `first` ends. Where that is
/// outside of the picture the result is NaN, which no warp takes for inside.
///
/// # Panics
/// When the fields differ in size.
pub fn composed(first: &Field, second: &Field) -> Field {
    assert!(first.same_size(second), "fields of one size");
    let (height, width) = (first.height(), first.width());
    Image::from_rows(2, height, width, |c, y, row| {
        let (dx, dy) = (first.row(0, y), first.row(1, y));
        for (x, out) in row.iter_mut().enumerate() {
            let taps = Taps::at(x as f32 + dx[x], y as f32 + dy[x], height, width);
            let own = if c == 0 { dx[x] } else { dy[x] };
            *out = taps.map_or(f32::NAN, |taps| own + bilinear(second.plane(c), width, &taps));
        }
    })
}

/// The field of the full buffer from those of its halves: their mean where they agree, else that of the half that is more
/// valid there; `valid` are the halves' validities `[1, H, W]`.
///
/// # Panics
/// When sizes differ.
pub fn of_full(halves: [&Field; 2], valid: [&Image; 2]) -> Field {
    let [a, b] = halves;
    assert!(a.same_size(b) && valid.iter().all(|v| v.same_size(a)), "fields of one size");
    Image::from_rows(2, a.height(), a.width(), |c, y, row| {
        let [a_x, b_x, a_y, b_y] = [a.row(0, y), b.row(0, y), a.row(1, y), b.row(1, y)];
        let (own, other) = (a.row(c, y), b.row(c, y));
        let (v_a, v_b) = (valid[0].row(0, y), valid[1].row(0, y));
        for (x, out) in row.iter_mut().enumerate() {
            let near = (a_x[x] - b_x[x]).abs().max((a_y[x] - b_y[x]).abs()) <= SAME_THING;
            *out = match near {
                true => 0.5 * own[x] + 0.5 * other[x],
                false if v_b[x] > v_a[x] => other[x],
                false => own[x],
            };
        }
    })
}
