//! Where training looks more often: where the denoiser is least sure.
//!
//! The denoiser's outputs on both halves differ by its own error in them, without the noise of y and
//! its outliers; blocks where they differ more are where there is more to mend. (The noise of y says
//! less: it is large in many places that the denoiser gets right.)

use rayon::prelude::*;
use sspc_core::objective::own_weight;
use sspc_core::prepare::Prepared;
use sspc_kernels::features::DENOISED;
use sspc_kernels::region::Region;

/// Importance of a block in which the halves agree, against the mean of the rest.
const FLOOR: f64 = 0.3;

/// How often each of `blocks` should be trained on, against the others: [`FLOOR`] and, on average over
/// the blocks, about 1. All alike where the denoised halves are equal everywhere.
///
/// Of a pixel, with e² = ‖z^a - z^b‖² / (z̄² + 0.01) (the mean of both halves' denominators), it is √(1 + e²) - 1: a square for small
/// differences, linear for large ones.
pub fn importance(prepared: &Prepared, blocks: &[Region]) -> Vec<f64> {
    let weights = [0, 1].map(|h| own_weight(prepared, h));
    let [a, b] = &prepared.halves;
    let of_pixel = |y: usize, x: usize| {
        let squares = (DENOISED..DENOISED + 3).map(|k| f64::from(a.at(k, y, x) - b.at(k, y, x)).powi(2));
        let weight = weights.iter().map(|w| 0.5 * f64::from(w.at(0, y, x))).sum::<f64>();
        (1.0 + weight * squares.sum::<f64>()).sqrt() - 1.0
    };
    let of_block = |block: &Region| {
        let rows = block.top..block.top + block.height;
        let pixels = rows.flat_map(|y| (block.left..block.left + block.width).map(move |x| (y, x)));
        pixels.map(|(y, x)| of_pixel(y, x)).sum::<f64>() / block.pixels() as f64
    };
    let differences: Vec<f64> = blocks.par_iter().map(of_block).collect();
    let mean = differences.iter().sum::<f64>() / blocks.len().max(1) as f64;
    differences.iter().map(|d| FLOOR + if mean > 0.0 { rounded(d / mean) } else { 1.0 }).collect()
}

/// The nearest power of √2 (0 of 0): a frame in other units, whose values are rounded elsewhere, has the
/// same blocks drawn.
fn rounded(share: f64) -> f64 {
    (0.5 * (2.0 * share.log2()).round()).exp2()
}

#[cfg(test)]
mod tests {
    use super::*;
    use sspc_image::Image;
    use sspc_kernels::features::FEATURE_CHANNELS;
    use sspc_testkit::frames::prepared;

    fn scene(second: f32) -> Prepared {
        let half = |z: f32| {
            let value = |c, _, x| if c >= DENOISED && x >= 16 { z } else { 0.5 };
            Image::from_fn(FEATURE_CHANNELS, 16, 48, value)
        };
        prepared([half(0.5), half(second)])
    }

    #[test]
    fn blocks_count_by_what_the_denoised_halves_disagree_on() {
        let blocks = [0, 16, 32].map(|left| Region { top: 0, left, height: 16, width: 16 });
        assert_eq!(importance(&scene(0.5), &blocks), [1.3; 3], "equal halves");
        // The first block's halves agree, the other two differ alike; the mean is two thirds of theirs.
        let of_blocks = importance(&scene(0.7), &blocks);
        // 1.5 is nearest to √2.
        for (found, expected) in of_blocks.iter().zip([0.3, 0.3 + 2f64.sqrt(), 0.3 + 2f64.sqrt()]) {
            assert!((found - expected).abs() < 1e-6, "{of_blocks:?}");
        }
    }
}
