//! The sidecar: every figure and setting of one frame.

use super::arguments::Job;
use super::shared::Shared;
use crate::clock;
use serde::Serialize;
use sspc_cli::DenoiserReport;
use sspc_cli::passes::PassesReport;
use sspc_cli::record::{FilledRole, SamplesReport, peak_rss_bytes, shown_path};
use sspc_cli::shot::report::NeighbourReport;
use sspc_core::composition::Composition;
use sspc_core::correct::Corrected;
use sspc_core::estimate::{Estimate, Losses};
use sspc_core::frame_stats::{Findings, FrameStats};
use sspc_core::independence::Independence;
use sspc_frames::samples::HalfSamples;
use sspc_image::RoleSource;
use sspc_kernels::features::FeatureSet;
use sspc_kernels::parameters::Form;

/// Wall-clock seconds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct FrameSeconds {
    /// Files to pixels, and looking them over: exposure, features in use, usable halves.
    pub read: f64,
    /// Pixels to feature tensors.
    pub features: f64,
    /// Features to parameters, g_c, weights and picture.
    pub correct: f64,
    /// Picture to file.
    pub write: f64,
    /// All of it.
    pub total: f64,
}

/// relL2 against the reference.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct RelL2 {
    /// The mean of both halves' noisy radiance.
    pub noisy: f64,
    /// The denoiser's picture.
    pub denoised: f64,
    /// The finished picture.
    pub corrected: f64,
    /// The reference's own noise was taken out by its halves.
    pub reference_noise_removed: bool,
}

/// Where the model comes from.
#[derive(Clone, Debug, Serialize)]
pub struct Origin {
    /// The model's file.
    pub path: String,
    /// Form of its parameters.
    pub form: Form,
    /// What its picture is made of.
    pub composition: Composition,
    /// Radius of g_c's window, pixels.
    pub window_radius: usize,
    /// The frames that it was fitted on.
    pub frames: Vec<String>,
    /// The preset of the fit.
    pub preset: String,
    /// Steps of the fit.
    pub steps: u64,
    /// Seed of the fit.
    pub seed: u64,
    /// Program and version that fitted it.
    pub tool: String,
}

/// Everything `--json` writes.
#[derive(Clone, Debug, Serialize)]
pub struct FrameReport {
    /// Version of the program.
    pub version: &'static str,
    /// Number in a shot.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<i32>,
    /// The picture's file.
    pub output: String,
    /// The model, and where it comes from.
    pub model: Origin,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// What radiance was multiplied by.
    pub exposure: f32,
    /// Features that took part.
    pub features: FeatureSet,
    /// Unusual pixels and features.
    pub found: Findings,
    /// What the halves say of each other.
    pub independence: Independence,
    /// Against the reference, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rel_l2: Option<RelL2>,
    /// Self-supervised loss of both halves, the denoiser's and ours.
    pub loss: Losses,
    /// Estimated relL2 of the mean of both halves, the denoiser's and ours.
    pub estimate: Estimate,
    /// The same loss of the model's correction as it is, before any judgement.
    pub model_loss: f64,
    /// Why the picture is the denoiser's, if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fallback: Option<String>,
    /// That the model does not suit the frame, if it does not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub unlike: Option<String>,
    /// Share of the judged correction that was asked for, 0..1.
    pub strength: f32,
    /// Mean share of the correction that was used, as the judge and strength have it, 0..1.
    pub mean_share: f64,
    /// Share of the pixels that were computed; the others show no noise.
    pub active_share: f64,
    /// Mean weight of each network's correction; their sum is 1.
    pub network_weights: Vec<f64>,
    /// Mean share of what denoised passes make together in the correction, 0..1; absent without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub composite_share: Option<f64>,
    /// Instruction set of our kernels.
    pub instruction_set: &'static str,
    /// Threads of the run.
    pub threads: usize,
    /// Side of the network's tiles, pixels.
    pub tile: usize,
    /// Where the time went.
    pub seconds: FrameSeconds,
    /// FrameSeconds from the start of the program to the first tile's parameters, of the run's first frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_tile_after: Option<f64>,
    /// Most memory that the process has held so far, where the system tells.
    pub peak_rss_bytes: Option<u64>,
    /// Which channels filled which role.
    pub roles: Vec<FilledRole>,
    /// The samples of each half, and what they weigh.
    pub samples: SamplesReport,
    /// Which denoised pictures were made, where the files do not hold them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub denoiser: Option<DenoiserReport>,
    /// Additive passes that were corrected, where they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub passes: Option<PassesReport>,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Neighbouring frames of a shot, and what was done with them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub neighbours: Vec<NeighbourReport>,
}

impl FrameReport {
    /// Everything that is known of a corrected frame.
    pub fn new(
        shared: &Shared,
        job: &Job,
        stats: &FrameStats,
        roles: &[RoleSource],
        warnings: Vec<String>,
        corrected: &Corrected,
        seconds: FrameSeconds,
    ) -> Self {
        let contract = &shared.engine.model().contract;
        let first_tile = shared.engine.first_tile().and_then(clock::since_start);
        let verdict = &corrected.verdict;
        FrameReport {
            version: env!("CARGO_PKG_VERSION"),
            frame: job.frame.number,
            output: shown_path(&job.output),
            model: Origin {
                path: shown_path(&shared.arguments.model),
                form: contract.form,
                composition: contract.composition,
                window_radius: contract.window_radius,
                frames: contract.frames.clone(),
                preset: contract.preset.clone(),
                steps: contract.steps,
                seed: contract.seed,
                tool: contract.tool.clone(),
            },
            width: corrected.picture.width(),
            height: corrected.picture.height(),
            exposure: stats.exposure,
            features: stats.set,
            found: stats.found,
            independence: stats.independence,
            rel_l2: None,
            loss: verdict.loss,
            estimate: verdict.estimate,
            model_loss: verdict.model_loss,
            fallback: verdict.fallback.clone(),
            unlike: corrected.unlike(contract.composition),
            strength: shared.arguments.run.strength,
            mean_share: corrected.mean_share,
            active_share: corrected.active_share,
            network_weights: corrected.network_weights.clone(),
            composite_share: corrected.composite_share,
            instruction_set: shared.isa.name(),
            threads: rayon::current_num_threads(),
            tile: shared.arguments.tile,
            seconds,
            first_tile_after: first_tile.map(|after| after.as_secs_f64()),
            peak_rss_bytes: peak_rss_bytes(),
            roles: roles.iter().map(Into::into).collect(),
            samples: (&HalfSamples::UNKNOWN).into(),
            denoiser: None,
            passes: None,
            warnings,
            neighbours: Vec::new(),
        }
    }
}
