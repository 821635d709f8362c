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
use crate::objective::{RELATIVE_FLOOR, weight_of};
use crate::prepare::Prepared;
use crate::trust::Trust;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::{DENOISED, RADIANCE};
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
                    Pixels::of_row(prepared, corrected, share, correction, y).add_to(&mut blocks);
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

    fn add_to(&self, blocks: &mut [BlockSum]) {
        for (block, (sums, count)) in blocks.iter_mut().enumerate() {
            for x in block * BLOCK..((block + 1) * BLOCK).min(self.share.len()) {
                if self.valid.is_none_or(|valid| valid[x] != 0.0) {
                    sums.iter_mut().zip(self.quantities(x)).for_each(|(sum, value)| *sum += value);
                    *count += 3.0;
                }
            }
        }
    }

    #[inline(always)]
    fn quantities(&self, x: usize) -> [f64; QUANTITIES] {
        let mut losses = [0.0; 4];
        let mut squared = [0.0; 2];
        let mut blended = [[0.0f32; 3]; 2];
        for (h, blended) in blended.iter_mut().enumerate() {
            let z = [self.z[h][0][x], self.z[h][1][x], self.z[h][2][x]];
            let weight = f64::from(weight_of(z, RELATIVE_FLOOR));
            // ‖x - y‖² of z, blended and corrected, and what the second has less than the first.
            let (mut of_z, mut of_blended, mut of_corrected, mut gain) = (0.0, 0.0, 0.0, 0.0);
            for k in 0..3 {
                let (corrected, y) = (self.corrected[h][k][x], self.radiance[1 - h][k][x]);
                let mixed = (z[k] + self.share[x] * (corrected - z[k])).max(0.0);
                blended[k] = mixed;
                let square = |from: f32| f64::from(from - y) * f64::from(from - y);
                of_z += square(z[k]);
                of_blended += square(mixed);
                of_corrected += square(corrected);
                // (p - y)² - (q - y)² without the cancellation of two large squares.
                let (p, q) = (f64::from(z[k]), f64::from(mixed));
                gain += (p - q) * (p + q - 2.0 * f64::from(y));
            }
            for (loss, of) in losses.iter_mut().zip([of_z, of_blended, of_corrected, gain]) {
                *loss += 0.5 * weight * of;
            }
            squared[0] += 0.5 * of_z;
            squared[1] += 0.5 * of_blended;
        }
        let [w_a, w_b] = self.weights;
        let (mut variance, mut apart, mut differ) = (0.0, [0.0; 2], [0.0; 2]);
        let (mut finished, mut denoised) = (0.0, 0.0);
        let [a, b] = blended;
        for (k, (a, b)) in a.into_iter().zip(b).enumerate() {
            let square = |p: f32, q: f32| f64::from(p - q) * f64::from(p - q);
            variance += 0.5 * square(self.radiance[0][k][x], self.radiance[1][k][x]);
            apart[0] += square(self.z[0][k][x], self.z[1][k][x]);
            apart[1] += square(a, b);
            // ‖x - y‖² less ‖y‖² of half a, less the same of half b.
            let alone = |x: f32, y: f32| f64::from(x) * (f64::from(x) - 2.0 * f64::from(y));
            let y = [0, 1].map(|h| self.radiance[h][k][x]);
            differ[0] += alone(self.z[0][k][x], y[1]) - alone(self.z[1][k][x], y[0]);
            differ[1] += alone(a, y[1]) - alone(b, y[0]);
            finished += f64::from((self.denoised[k][x] + self.correction[k][x]).max(0.0));
            denoised += f64::from(self.denoised[k][x]);
        }
        let [finished, denoised] = [finished, denoised].map(|sum| (sum / 3.0) * (sum / 3.0) + self.floor);
        let error = |i: usize| squared[i] - variance + (w_a - 0.5) * differ[i] - w_a * w_b * apart[i];
        let [of_z, of_blended] = [error(0), error(1)];
        let [loss_z, loss_blended, loss_corrected, gain] = losses;
        let errors = [of_z, of_blended, of_z - of_blended];
        let [[z, z_by_z], [x, x_by_z], [fall, fall_by_z]] = errors.map(|error| [error / finished, error / denoised]);
        [loss_z, loss_blended, loss_corrected, gain, z, z_by_z, x, x_by_z, fall, fall_by_z, z * z, x * x, fall * fall]
    }
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
