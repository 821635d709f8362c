//! What is told of a fit, as JSON: the keys are those of `report.json`.

use serde::Serialize;
use sspc_core::frame_stats::{Findings, FrameStats};
use sspc_core::independence::Independence;
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
