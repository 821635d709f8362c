//! What is told of a corrected picture, as JSON: the keys are those of the sidecar of `sspc-infer run --json`.

use serde::Serialize;
use sspc_core::composition::Composition;
use sspc_core::correct::{Corrected, StageSeconds};
use sspc_core::estimate::{Estimate, Losses};
use sspc_core::frame_stats::{Findings, FrameStats};
use sspc_core::independence::Independence;
use sspc_kernels::features::FeatureSet;
use sspc_kernels::simd::Isa;

/// Of a corrected picture.
#[derive(Serialize)]
pub struct PictureReport {
    version: &'static str,
    width: usize,
    height: usize,
    exposure: f32,
    composition: Composition,
    features: FeatureSet,
    found: Findings,
    independence: Independence,
    loss: Losses,
    estimate: Estimate,
    model_loss: f64,
    /// Why the picture is the denoiser's; null where it is not.
    fallback: Option<String>,
    /// That the model does not suit the frame; null where it does.
    unlike: Option<String>,
    strength: f32,
    mean_share: f64,
    active_share: f64,
    network_weights: Vec<f64>,
    instruction_set: &'static str,
    threads: usize,
    seconds: StageSeconds,
    warnings: Vec<String>,
}

impl PictureReport {
    /// Everything that is known of a corrected frame.
    pub fn new(
        isa: Isa,
        composition: Composition,
        strength: f32,
        stats: &FrameStats,
        warnings: Vec<String>,
        corrected: &Corrected,
    ) -> Self {
        let verdict = &corrected.verdict;
        PictureReport {
            version: env!("CARGO_PKG_VERSION"),
            width: corrected.picture.width(),
            height: corrected.picture.height(),
            exposure: stats.exposure,
            composition,
            features: stats.set,
            found: stats.found,
            independence: stats.independence,
            loss: verdict.loss,
            estimate: verdict.estimate,
            model_loss: verdict.model_loss,
            fallback: verdict.fallback.clone(),
            unlike: corrected.unlike(composition),
            strength,
            mean_share: corrected.mean_share,
            active_share: corrected.active_share,
            network_weights: corrected.network_weights.clone(),
            instruction_set: isa.name(),
            threads: rayon::current_num_threads(),
            seconds: corrected.seconds,
            warnings,
        }
    }
    /// What a person should know.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }
}
