//! What a whole picture is judged by: sums over its blocks, band after band.
//!
//! **Loss** (Eq. 9): Σ ½ w^h ‖x^h - y‖² over both halves, y the other half's, w^h by the own half's z
//! ([`crate::objective::own_weight`]); **gain**, the difference of two losses.
//!
//! Differences of y that a gradient-domain renderer gives have no part in it: they see nothing of low frequencies, and of a
//! frame that lost 9 % of its light they said that it is better.
//!
//! **Error** of the mean of both halves: ½ Σ_h ‖x^h - y‖² - σ² + (w_a - ½) Δ - w_a w_b ‖x^a - x^b‖² over a squared brightness,
//! with the halves' weights w and Δ = x^a·(x^a - 2 y^b) - x^b·(x^b - 2 y^a). Finished and
//! denoised picture stand in for the reference there: they are made of both halves alike. Under a weight made of the half
//! compared with, whose z is large where its noise is, the squares of that half's noise weigh less than the variance that
//! is to cancel them, and the estimate falls below 0 in noisy frames; under a symmetric one squares and variance weigh
//! alike. They still depend on the same noise: where it makes the stand-in bright, errors count for less.

use crate::composition::Composition;
use crate::estimate::{BLOCK, Blocks, Errors, Estimate, Losses, Mean};
use crate::held_out;
use crate::lanes::{LANES, lanes, lanes_of_colour, widest};
use crate::objective::{RELATIVE_FLOOR, weight_of};
use crate::prepare::Prepared;
use crate::trust::Trust;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::{DENOISED, RADIANCE};
use sspc_kernels::simd::{Kernel, Simd};
use std::ops::Range;

/// Sums over the blocks of a picture, or of its first bands from top to bottom.
#[derive(Clone, Debug, Default)]
pub struct FrameSums {
    pub(crate) loss_denoised: Blocks,
    pub(crate) loss_corrected: Blocks,
    pub(crate) loss_unjudged: Blocks,
    pub(crate) gain: Blocks,
    /// Gain over the pixels that training left out, where it did.
    pub(crate) held_out_gain: Option<Blocks>,
    pub(crate) error_denoised: Errors,
    pub(crate) error_corrected: Errors,
    /// The first less the second.
    pub(crate) error_gain: Errors,
}

/// The judgement of a whole picture.
#[derive(Clone, Debug)]
pub struct Verdict {
    /// Self-supervised loss of both halves, the denoiser's and ours.
    pub loss: Losses,
    /// Loss of the correction as the model gives it, before any judgement.
    pub model_loss: f64,
    /// Estimated relL2 of the mean of both halves, variance term included.
    pub estimate: Estimate,
    /// Fall of the loss by the pixels that training left out: an unbiased figure, where there are enough of them.
    pub held_out_gain: Option<Mean>,
    /// Why the output is the denoiser's everywhere, if it is.
    pub fallback: Option<String>,
}

// A block is a run of pixels in each of its rows.
const _: () = assert!(LANES == BLOCK);
/// Quantities of a pixel: losses of z, of the blended and of the whole correction, gain, and the errors of z, of the
/// blended correction and the first less the second, under the finished and the denoised picture's brightness each; then the
/// squares of those three under the finished one's.
const QUANTITIES: usize = 13;
/// Those of a block, and its valid values.
type BlockSum = ([f64; QUANTITIES], f64);

impl FrameSums {
    /// Sums over `rows`, which begin at a multiple of [`BLOCK`]. Half h is z + share (`corrected` - z), no less than 0;
    /// `correction` `[3, H, W]` is what the finished picture adds to the denoiser's. All in the method's units.
    pub fn of(
        prepared: &Prepared,
        corrected: &[Image; 2],
        share: &Image,
        correction: &Image,
        rows: Range<usize>,
    ) -> Self {
        let tops: Vec<usize> = rows.clone().step_by(BLOCK).collect();
        let blocks: Vec<Vec<BlockSum>> = tops
            .into_par_iter()
            .map(|top| {
                let mut blocks = vec![([0.0; QUANTITIES], 0.0); prepared.width().div_ceil(BLOCK)];
                for y in top..(top + BLOCK).min(rows.end) {
                    let pixels = Pixels::of_row(prepared, corrected, share, correction, y);
                    widest(AddRow { pixels, blocks: &mut blocks });
                }
                blocks
            })
            .collect();
        let of = |n: usize| Blocks(blocks.iter().flatten().map(|(sums, count)| (sums[n], *count)).collect());
        let squares = |n: usize| blocks.iter().flatten().map(|(sums, _)| sums[n]).collect();
        let errors = |n: usize, square| Errors { finished: of(n), denoised: of(n + 1), squares: squares(square) };
        Self {
            loss_denoised: of(0),
            loss_corrected: of(1),
            loss_unjudged: of(2),
            gain: of(3),
            held_out_gain: None,
            error_denoised: errors(4, 10),
            error_corrected: errors(6, 11),
            error_gain: errors(8, 12),
        }
    }

    /// Adds the next band below.
    pub fn append(&mut self, next: FrameSums) {
        self.loss_denoised.append(next.loss_denoised);
        self.loss_corrected.append(next.loss_corrected);
        self.loss_unjudged.append(next.loss_unjudged);
        self.gain.append(next.gain);
        if let Some(gain) = next.held_out_gain {
            self.held_out_gain.get_or_insert_default().append(gain);
        }
        self.error_denoised.append(next.error_denoised);
        self.error_corrected.append(next.error_corrected);
        self.error_gain.append(next.error_gain);
    }

    /// Whether the correction stays, and what the frame says of the error.
    pub fn verdict(&self, composition: Composition, trust: Trust) -> Verdict {
        let fallback = match composition {
            Composition::MeanOfHalves => None,
            Composition::JudgedFullBuffer => self.fallback(trust),
        };
        let nothing = self.error_gain.nothing();
        let (loss, error, gain) = match fallback {
            Some(_) => (&self.loss_denoised, &self.error_denoised, &nothing),
            None => (&self.loss_corrected, &self.error_corrected, &self.error_gain),
        };
        Verdict {
            model_loss: self.loss_unjudged.mean().value,
            loss: Losses { denoised: self.loss_denoised.mean().value, corrected: loss.mean().value },
            estimate: Estimate::of(&self.error_denoised, error, gain, fallback.is_none()),
            held_out_gain: self.held_out_gain(),
            fallback,
        }
    }

    fn held_out_gain(&self) -> Option<Mean> {
        self.held_out_gain.as_ref().filter(|blocks| blocks.len() >= held_out::FEWEST).map(Blocks::mean)
    }

    /// Why the denoiser's picture is the better answer, if it is.
    fn fallback(&self, trust: Trust) -> Option<String> {
        if let Trust::None(distrust) = trust {
            return Some(distrust.to_string());
        }
        for error in [&self.error_denoised, &self.error_corrected].map(Errors::mean) {
            if is_impossible(error) {
                return Some(format!(
                    "the estimated relL2 is below 0 ({}): the halves are not independent",
                    shown(error)
                ));
            }
        }
        if let Some(gain) = self.held_out_gain()
            && gain.value + gain.standard_error.unwrap_or(f64::INFINITY) < 0.0
        {
            return Some(format!("pixels that were not trained on say that it is no better: gain {}", shown(gain)));
        }
        let gain = self.gain.mean();
        match gain {
            // A gain that is not a number is no gain.
            Mean { value, .. } if value > 0.0 => None,
            Mean { value, standard_error: Some(_) } if value != 0.0 => {
                Some(format!("the self-supervised loss does not fall: gain {}", shown(gain)))
            }
            _ => Some("nothing is added to the denoiser's picture".to_string()),
        }
    }
}

/// Adds the pixels of a row to its blocks.
struct AddRow<'a> {
    pixels: Pixels<'a>,
    blocks: &'a mut [BlockSum],
}

impl Kernel for AddRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        self.pixels.add_to(self.blocks);
    }
}

/// A row of everything that a picture is judged by; by halves and channels.
struct Pixels<'a> {
    z: [[&'a [f32]; 3]; 2],
    radiance: [[&'a [f32]; 3]; 2],
    corrected: [[&'a [f32]; 3]; 2],
    share: &'a [f32],
    denoised: [&'a [f32]; 3],
    correction: [&'a [f32]; 3],
    valid: Option<&'a [f32]>,
    /// Of the halves, in means of both.
    weights: [f64; 2],
    /// 0.01 of relL2 in the method's units.
    floor: f64,
}

impl<'a> Pixels<'a> {
    fn of_row(
        prepared: &'a Prepared,
        corrected: &'a [Image; 2],
        share: &'a Image,
        correction: &'a Image,
        y: usize,
    ) -> Self {
        let channels = |image: &'a Image, first: usize| [0, 1, 2].map(|k| image.row(first + k, y));
        Self {
            z: [0, 1].map(|h| channels(&prepared.halves[h], DENOISED)),
            radiance: [0, 1].map(|h| channels(&prepared.halves[h], RADIANCE)),
            corrected: [0, 1].map(|h| channels(&corrected[h], 0)),
            share: share.row(0, y),
            denoised: channels(&prepared.denoised, 0),
            correction: channels(correction, 0),
            valid: prepared.valid.as_ref().map(|valid| valid.row(0, y)),
            weights: [0, 1].map(|h| f64::from(prepared.weights.of(h))),
            floor: f64::from(RELATIVE_FLOOR * prepared.exposure * prepared.exposure),
        }
    }

    #[inline(always)]
    fn add_to(&self, blocks: &mut [BlockSum]) {
        for (block, (sums, count)) in blocks.iter_mut().enumerate() {
            let first = block * BLOCK;
            let quantities = self.quantities(first);
            for i in 0..LANES.min(self.share.len() - first) {
                if self.valid.is_none_or(|valid| valid[first + i] != 0.0) {
                    for (sum, values) in sums.iter_mut().zip(&quantities) {
                        *sum += values[i];
                    }
                    *count += 3.0;
                }
            }
        }
    }

    /// Of the pixels of a block.
    #[inline(always)]
    fn quantities(&self, first: usize) -> [[f64; LANES]; QUANTITIES] {
        let share = lanes(self.share, first);
        let mut losses = [[0.0; LANES]; 4];
        let mut squares = [[0.0; LANES]; 2];
        let mut blended = [[[0.0f32; LANES]; 3]; 2];
        for (h, blended) in blended.iter_mut().enumerate() {
            let z = lanes_of_colour(&self.z[h], first);
            let corrected = lanes_of_colour(&self.corrected[h], first);
            let radiance = lanes_of_colour(&self.radiance[1 - h], first);
            // ‖x - y‖² of z, blended and corrected, and what the second has less than the first.
            let mut of = [[0.0; LANES]; 4];
            for k in 0..3 {
                for i in 0..LANES {
                    let mixed = (z[k][i] + share[i] * (corrected[k][i] - z[k][i])).max(0.0);
                    blended[k][i] = mixed;
                    let y = radiance[k][i];
                    let less_y = (f64::from(z[k][i] - y), f64::from(mixed - y), f64::from(corrected[k][i] - y));
                    of[0][i] += less_y.0 * less_y.0;
                    of[1][i] += less_y.1 * less_y.1;
                    of[2][i] += less_y.2 * less_y.2;
                    // (p - y)² - (q - y)² without the cancellation of two large squares.
                    let (p, q) = (f64::from(z[k][i]), f64::from(mixed));
                    of[3][i] += (p - q) * (p + q - 2.0 * f64::from(y));
                }
            }
            for i in 0..LANES {
                let weight = f64::from(weight_of([z[0][i], z[1][i], z[2][i]], RELATIVE_FLOOR));
                for (loss, of) in losses.iter_mut().zip(&of) {
                    loss[i] += 0.5 * weight * of[i];
                }
                squares[0][i] += 0.5 * of[0][i];
                squares[1][i] += 0.5 * of[1][i];
            }
        }
        let [w_a, w_b] = self.weights;
        let z = [lanes_of_colour(&self.z[0], first), lanes_of_colour(&self.z[1], first)];
        let radiance = [lanes_of_colour(&self.radiance[0], first), lanes_of_colour(&self.radiance[1], first)];
        let (pictures, corrections) =
            (lanes_of_colour(&self.denoised, first), lanes_of_colour(&self.correction, first));
        let [mut variance, mut finished, mut denoised] = [[0.0; LANES]; 3];
        let (mut apart, mut differ) = ([[0.0; LANES]; 2], [[0.0; LANES]; 2]);
        for k in 0..3 {
            for i in 0..LANES {
                let (y_a, y_b) = (radiance[0][k][i], radiance[1][k][i]);
                variance[i] += 0.5 * square(y_a, y_b);
                apart[0][i] += square(z[0][k][i], z[1][k][i]);
                apart[1][i] += square(blended[0][k][i], blended[1][k][i]);
                differ[0][i] += alone(z[0][k][i], y_b) - alone(z[1][k][i], y_a);
                differ[1][i] += alone(blended[0][k][i], y_b) - alone(blended[1][k][i], y_a);
                finished[i] += f64::from((pictures[k][i] + corrections[k][i]).max(0.0));
                denoised[i] += f64::from(pictures[k][i]);
            }
        }
        let mut quantities = [[0.0; LANES]; QUANTITIES];
        for i in 0..LANES {
            let by_finished = (finished[i] / 3.0) * (finished[i] / 3.0) + self.floor;
            let by_denoised = (denoised[i] / 3.0) * (denoised[i] / 3.0) + self.floor;
            let of_z = squares[0][i] - variance[i] + (w_a - 0.5) * differ[0][i] - w_a * w_b * apart[0][i];
            let of_blended = squares[1][i] - variance[i] + (w_a - 0.5) * differ[1][i] - w_a * w_b * apart[1][i];
            let errors = [of_z, of_blended, of_z - of_blended];
            for n in 0..3 {
                let by_finished = errors[n] / by_finished;
                quantities[4 + 2 * n][i] = by_finished;
                quantities[5 + 2 * n][i] = errors[n] / by_denoised;
                quantities[10 + n][i] = by_finished * by_finished;
            }
            for (quantity, loss) in quantities.iter_mut().zip(&losses) {
                quantity[i] = loss[i];
            }
        }
        quantities
    }
}

/// (p - q)²
#[inline(always)]
fn square(p: f32, q: f32) -> f64 {
    f64::from(p - q) * f64::from(p - q)
}

/// (x - y)² less y²
#[inline(always)]
fn alone(x: f32, y: f32) -> f64 {
    f64::from(x) * (f64::from(x) - 2.0 * f64::from(y))
}

/// Standard errors by which an estimate is below zero by more than chance.
pub const BY_CHANCE: f64 = 3.0;

/// Whether an error is below zero by more than chance makes it.
fn is_impossible(error: Mean) -> bool {
    error.standard_error.is_some_and(|s| error.value < -BY_CHANCE * s)
}

fn shown(mean: Mean) -> String {
    let error = mean.standard_error.map_or(String::new(), |error| format!(" ± {error:.1e}"));
    format!("{:.3e}{error}", mean.value)
}
