//! The sidecar: every figure and setting of one frame.

use super::correct::Corrected;
use super::frame::Setting;
use super::jobs::Job;
use crate::clock;
use serde::Serialize;
use sspc_core::estimate::{Estimate, Losses};
use sspc_core::finish::Composition;
use sspc_core::prepare::Findings;
use sspc_image::RoleSource;
use sspc_kernels::features::FeatureSet;
use sspc_kernels::parameters::Form;
use std::path::PathBuf;

/// Wall-clock seconds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Seconds {
    /// Files to pixels, and looking them over: exposure, features in use, usable halves.
    pub read: f64,
    /// Pixels to feature tensors.
    pub features: f64,
    /// Features to parameters.
    pub network: f64,
    /// g_c, judgement and picture.
    pub finish: f64,
    /// Picture to file.
    pub write: f64,
    pub total: f64,
}

/// A frame's size and which channels fill its roles.
#[derive(Clone, Debug)]
pub struct Looks {
    pub height: usize,
    pub width: usize,
    pub sources: Vec<RoleSource>,
}

/// Where the model comes from.
#[derive(Clone, Debug, Serialize)]
pub struct Origin {
    pub path: PathBuf,
    pub form: Form,
    pub composition: Composition,
    pub window_radius: usize,
    pub frames: Vec<String>,
    pub preset: String,
    pub steps: u64,
    pub seed: u64,
    pub tool: String,
}

/// Which channels filled which role.
#[derive(Clone, Debug, Serialize)]
pub struct Filled {
    pub role: String,
    pub buffer: String,
    pub file: PathBuf,
    pub channels: Vec<String>,
}

impl From<&RoleSource> for Filled {
    fn from(source: &RoleSource) -> Self {
        Filled {
            role: source.role.to_string(),
            buffer: source.buffer.to_string(),
            file: source.path.clone(),
            channels: source.channels.clone(),
        }
    }
}

/// Everything `--json` writes.
#[derive(Clone, Debug, Serialize)]
pub struct Report {
    pub version: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub frame: Option<u32>,
    pub output: PathBuf,
    pub model: Origin,
    pub width: usize,
    pub height: usize,
    /// What radiance was multiplied by.
    pub exposure: f32,
    pub features: FeatureSet,
    pub found: Findings,
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
    pub instruction_set: &'static str,
    pub threads: usize,
    pub tile: usize,
    pub seconds: Seconds,
    /// Seconds from the start of the program to the first tile's parameters, of the run's first frame.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub first_tile_after: Option<f64>,
    pub peak_rss_bytes: Option<u64>,
    pub roles: Vec<Filled>,
    pub warnings: Vec<String>,
}

impl Report {
    /// Everything but the times.
    pub fn new(setting: &Setting, job: &Job, frame: Looks, warnings: Vec<String>, corrected: &Corrected) -> Self {
        let contract = &setting.engine.model().contract;
        let first_tile = setting.engine.first_tile().and_then(clock::since_start);
        Report {
            version: env!("CARGO_PKG_VERSION"),
            frame: job.number,
            output: job.output.clone(),
            model: Origin {
                path: setting.arguments.model.clone(),
                form: contract.form,
                composition: contract.composition,
                window_radius: contract.window_radius,
                frames: contract.frames.clone(),
                preset: contract.preset.clone(),
                steps: contract.steps,
                seed: contract.seed,
                tool: contract.tool.clone(),
            },
            width: frame.width,
            height: frame.height,
            exposure: corrected.survey.exposure,
            features: corrected.survey.set,
            found: corrected.survey.found,
            loss: corrected.loss,
            estimate: corrected.estimate,
            model_loss: corrected.model_loss,
            fallback: corrected.fallback.clone(),
            unlike: corrected.unlike(contract.composition),
            strength: setting.arguments.strength,
            mean_share: corrected.mean_share,
            active_share: corrected.active_share,
            instruction_set: setting.isa.name(),
            threads: rayon::current_num_threads(),
            tile: setting.arguments.tile,
            seconds: Seconds::default(),
            first_tile_after: first_tile.map(|after| after.as_secs_f64()),
            peak_rss_bytes: None,
            roles: frame.sources.iter().map(Into::into).collect(),
            warnings,
        }
    }

    /// Adds what is known at the end only.
    pub fn finish(&mut self, seconds: Seconds) {
        self.seconds = seconds;
        self.peak_rss_bytes = peak_rss_bytes();
    }

    pub fn to_json(&self) -> Vec<u8> {
        // Plain structures of numbers and texts: nothing in them can fail to serialise.
        serde_json::to_vec_pretty(self).unwrap_or_default()
    }
}

/// Most memory this process has held, where the system tells (Linux).
fn peak_rss_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().nth(1)?.parse().ok()?;
    Some(kib * 1024)
}
