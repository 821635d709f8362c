//! What a whole picture is judged by: sums over its blocks, band after band.

use crate::composition::Composition;
use crate::estimate::{Blocks, Errors, Estimate, Losses, Mean};
use crate::held_out;
use crate::trust::Trust;

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

impl FrameSums {
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
    }

    /// Whether the correction stays, and what the frame says of the error.
    pub fn verdict(&self, composition: Composition, trust: Trust) -> Verdict {
        let fallback = match composition {
            Composition::MeanOfHalves => None,
            Composition::JudgedFullBuffer => self.fallback(trust),
        };
        let (loss, error) = match fallback {
            Some(_) => (&self.loss_denoised, &self.error_denoised),
            None => (&self.loss_corrected, &self.error_corrected),
        };
        Verdict {
            model_loss: self.loss_unjudged.mean().value,
            loss: Losses { denoised: self.loss_denoised.mean().value, corrected: loss.mean().value },
            estimate: Estimate {
                denoised: self.error_denoised.mean(),
                corrected: error.mean(),
                gain: self.error_denoised.less(error).mean(),
            },
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

/// Whether an error is below zero by more than chance makes it.
fn is_impossible(error: Mean) -> bool {
    /// Standard errors.
    const BY_CHANCE: f64 = 3.0;
    error.standard_error.is_some_and(|s| error.value < -BY_CHANCE * s)
}

fn shown(mean: Mean) -> String {
    let error = mean.standard_error.map_or(String::new(), |error| format!(" ± {error:.1e}"));
    format!("{:.3e}{error}", mean.value)
}
