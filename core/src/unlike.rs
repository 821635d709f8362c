//! Whether a model suits the frame that it corrected.

use crate::composition::Composition;
use crate::correct::Corrected;

impl Corrected {
    /// In words that the model does not suit the frame, if it does not: by the self-supervised loss its correction as it
    /// is comes out worse than the denoiser, as that of a model fitted to other scenes or noise would.
    pub fn unlike(&self, composition: Composition) -> Option<String> {
        let (model, denoiser) = (self.verdict.model_loss, self.verdict.loss.denoised);
        // A loss that is not a number is no better.
        if model <= denoiser {
            return None;
        }
        let outcome = match (&self.verdict.fallback, composition) {
            (Some(_), _) => "nothing of its correction was used".to_string(),
            (None, Composition::JudgedFullBuffer) => {
                format!("{:.0} % of its correction was used, where it helps", 100.0 * self.mean_share)
            }
            (None, Composition::MeanOfHalves) => {
                "the picture is as the model makes it, since it asks for no judgement".to_string()
            }
        };
        Some(format!(
            "the frame is unlike those that the model was fitted on: its loss is {model:.4}, the denoiser's {denoiser:.4}; {outcome}"
        ))
    }
}
