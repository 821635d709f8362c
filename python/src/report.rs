//! What is told of a fit and of a picture, as JSON: the keys are those of `report.json` and of the sidecar of
//! `sspc-infer run --json`.

use serde::Serialize;
use sspc_core::composition::Composition;
use sspc_core::correct::{Corrected, StageSeconds};
use sspc_core::estimate::{Estimate, Losses};
use sspc_core::frame_stats::{Findings, FrameStats};
use sspc_core::independence::Independence;
use sspc_kernels::features::FeatureSet;
use sspc_kernels::simd::Isa;
use sspc_train::fit::{End, StepRecord};
use sspc_train::fits::Fits;
use sspc_train::preset::{Preset, Settings};
use sspc_train::report::Skipped;

/// Of a fit.
#[derive(Serialize)]
pub struct FitReport {
    version: &'static str,
    preset: Preset,
    seed: u64,
    instruction_set: &'static str,
    threads: usize,
    width: usize,
    height: usize,
    exposure: f32,
    steps: usize,
    steps_dropped: usize,
    end: End,
    /// Wall-clock time of training, seconds.
    seconds: f64,
    found: Findings,
    independence: Independence,
    skipped: Vec<Skipped>,
    warnings: Vec<String>,
    settings: Settings,
    planned_steps: usize,
    history: Vec<StepRecord>,
}

/// What is known of a frame before the fit.
pub struct Known {
    /// Height and width in pixels.
    pub size: (usize, usize),
    /// What was decided for the whole frame.
    pub stats: FrameStats,
    /// What is left out, and why.
    pub skipped: Vec<Skipped>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

impl FitReport {
    /// Everything that is known of a fit.
    pub fn new(isa: Isa, settings: Settings, known: Known, fitted: &Fits) -> Self {
        let Known { size: (height, width), stats, skipped, warnings } = known;
        FitReport {
            version: env!("CARGO_PKG_VERSION"),
            preset: settings.preset,
            seed: settings.seed,
            instruction_set: isa.name(),
            threads: rayon::current_num_threads(),
            width,
            height,
            exposure: stats.exposure,
            steps: fitted.history.len(),
            steps_dropped: fitted.dropped,
            end: fitted.end,
            seconds: fitted.seconds,
            found: stats.found,
            independence: stats.independence,
            skipped,
            warnings,
            settings,
            planned_steps: fitted.planned,
            history: fitted.history.clone(),
        }
    }
}

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
            instruction_set: isa.name(),
            threads: rayon::current_num_threads(),
            seconds: corrected.seconds,
            warnings,
        }
    }
}
