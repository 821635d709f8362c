//! Pixels that training does not look at, so that they judge the trained correction without having shaped it.
//!
//! Weights that were fitted to y^b reproduce some of its noise, and by the pixels that they were fitted to the correction
//! seems to help wherever it does. One block in [`ONE_IN`] is left out of the loss; the gain over those is unbiased but
//! for what their y lends to the windows of their neighbours. The blend weight that goes with it is made of the other
//! blocks' evidence alone. (Not so that of the picture: made from folds of blocks it was worse on every frame, by up to
//! 0.11 of the denoiser's error, since the halves' corrections are noisier than the full buffer's, and the two errors
//! cancel.)

use crate::estimate::BLOCK;
use sspc_image::Image;

/// One block in so many is not trained on.
pub const ONE_IN: usize = 8;
/// Fewer held-out blocks than this do not judge a picture.
pub const FEWEST: usize = 20;
/// Blocks that a row of blocks is shifted by against the one above: held-out blocks never touch.
const SHIFT: usize = 3;

/// Whether a picture has blocks enough for the held-out ones to judge it.
pub fn are_enough(height: usize, width: usize) -> bool {
    height.div_ceil(BLOCK) * width.div_ceil(BLOCK) >= ONE_IN * (FEWEST + 1)
}

/// Whether training leaves out pixel (y, x) of a picture.
pub fn is_held_out(y: usize, x: usize) -> bool {
    (y / BLOCK * SHIFT + x / BLOCK).is_multiple_of(ONE_IN)
}

/// Sets a weight `[1, H, W]` to 0 at the pixels that training leaves out.
pub(crate) fn blind(weight: &mut Image) {
    weight.for_each_row(|_, y, row| {
        row.iter_mut().enumerate().filter(|(x, _)| is_held_out(y, *x)).for_each(|(_, w)| *w = 0.0);
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_block_in_eight_is_held_out_and_none_touches_another() {
        let (rows, columns) = (3 * ONE_IN, 2 * ONE_IN);
        let held_out = |y: usize, x: usize| is_held_out(y * BLOCK + BLOCK - 1, x * BLOCK);
        let blocks = || (0..rows).flat_map(|y| (0..columns).map(move |x| (y, x)));
        assert_eq!(blocks().filter(|&(y, x)| held_out(y, x)).count(), rows * columns / ONE_IN);
        for (y, x) in blocks().filter(|&(y, x)| held_out(y, x)) {
            let around = blocks().filter(|&(v, u)| v.abs_diff(y) <= 1 && u.abs_diff(x) <= 1);
            assert_eq!(around.filter(|&(v, u)| held_out(v, u)).count(), 1, "{y} {x}");
        }
    }

    #[test]
    fn a_blind_weight_is_zero_there_and_nowhere_else() {
        let mut weight = Image::filled(1, 37, 150, 2.0);
        blind(&mut weight);
        for (y, x) in (0..37).flat_map(|y| (0..150).map(move |x| (y, x))) {
            assert_eq!(weight.at(0, y, x), if is_held_out(y, x) { 0.0 } else { 2.0 });
        }
    }
}
