//! report.json: every figure and setting of a fit.

use crate::fit::{End, StepRecord};
use crate::preset::{Preset, Settings};
use serde::Serialize;
use sspc_cli::DenoiserReport;
use sspc_cli::passes::PassesReport;
use sspc_cli::record::{FilledRole, SamplesReport};
use sspc_cli::shot::report::NeighbourReport;
use sspc_core::composition::Composition;
use sspc_core::estimate::{Estimate, Losses, Mean};
use sspc_core::frame_stats::Findings;
use sspc_core::independence::Independence;
use sspc_core::prepare::Prepared;
use sspc_image::{Image, Reference};
use sspc_kernels::features::FeatureSet;
use sspc_metrics::rel_l2;

/// relL2 against the reference.
#[derive(Clone, Debug, Serialize)]
pub struct RelL2 {
    /// The mean of both halves' noisy radiance.
    pub noisy: f64,
    /// The denoiser's picture.
    pub denoised: f64,
    /// The finished picture.
    pub corrected: f64,
    /// The best that any one mix of noisy and denoised could have done: the naive competitor.
    pub best_mix: Mix,
    /// Of the mean of both halves; None where pixels are missing.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub halves: Option<HalvesRelL2>,
    /// The reference's own noise was taken out by its halves.
    pub reference_noise_removed: bool,
}

/// relL2 of the pictures that the estimate of the error speaks of: means of both halves, from which
/// the finished picture differs by the full buffer's z.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct HalvesRelL2 {
    /// Mean of the denoised halves.
    pub denoised: f64,
    /// Mean of the corrected halves.
    pub corrected: f64,
}

/// A mix z + share (y - z) and its relL2.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Mix {
    /// Share of the noisy picture, 0..1.
    pub share: f64,
    /// Its relL2.
    pub rel_l2: f64,
}

/// What a corrected picture is measured beside, all of it known before training.
#[derive(Clone, Copy, Debug)]
pub struct Rivals {
    noisy: f64,
    denoised: f64,
    best_mix: Mix,
    /// Of the mean of the halves' denoised pictures.
    denoised_halves: Option<f64>,
}

impl Rivals {
    /// Measures noisy and denoised pictures `[3, H, W]` of one frame; `halves` is the mean of the
    /// halves' denoised pictures, where no pixel is missing.
    pub fn measure(noisy: &Image, denoised: &Image, halves: Option<Image>, reference: &Reference) -> Self {
        let of = |picture: &Image| rel_l2(picture, reference).value;
        let (y, z) = (of(noisy), of(denoised));
        // relL2 is a parabola in the share: its values at 0, 1/2 and 1 give its lowest point.
        let half = of(&Image::mean_of(noisy, denoised));
        let curvature = 2.0 * (y + z - 2.0 * half);
        let slope = y - z - curvature;
        let share = if curvature > 0.0 { (-slope / (2.0 * curvature)).clamp(0.0, 1.0) } else { 0.0 };
        let best_mix = Mix { share, rel_l2: z + share * (slope + share * curvature) };
        Self { noisy: y, denoised: z, best_mix, denoised_halves: halves.as_ref().map(of) }
    }
}

impl RelL2 {
    /// Measures the corrected picture `[3, H, W]`, and the mean of both halves in the frame's units that the estimate is
    /// of; the denoiser's without it.
    pub fn measure(corrected: &Image, halves: Option<&Image>, rivals: &Rivals, reference: &Reference) -> Self {
        let Rivals { noisy, denoised, best_mix, denoised_halves } = *rivals;
        let of = |picture: &Image| rel_l2(picture, reference).value;
        RelL2 {
            noisy,
            denoised,
            corrected: of(corrected),
            best_mix,
            halves: denoised_halves.map(|denoised| HalvesRelL2 { denoised, corrected: halves.map_or(denoised, of) }),
            reference_noise_removed: reference.halves.is_some(),
        }
    }
}

/// Wall-clock seconds.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct FitSeconds {
    /// Files to frames in the method's units.
    pub read: f64,
    /// All steps.
    pub train: f64,
    /// Network to picture.
    pub correct: f64,
    /// Pictures and model to files.
    pub write: f64,
    /// All of it.
    pub total: f64,
}

/// Something that was left out, and the measurement that justified it.
#[derive(Clone, Debug, Serialize)]
pub struct Skipped {
    /// What was left out.
    pub what: String,
    /// The measurement that justified it.
    pub why: String,
}

/// What a prepared frame lets the kernels leave out.
pub fn skipped(prepared: &Prepared) -> Vec<Skipped> {
    let mut out: Vec<Skipped> = FeatureSet::ALL
        .without(prepared.set)
        .iter()
        .map(|role| Skipped {
            what: role.name().into(),
            why: "absent, nowhere finite, or the same at every pixel".into(),
        })
        .collect();
    if prepared.plan.active_share < 1.0 {
        let why =
            format!("{:.1} % of the pixels lie in blocks without noise", 100.0 * (1.0 - prepared.plan.active_share));
        out.push(Skipped { what: "still blocks".into(), why });
    }
    if prepared.found.missing_pixels > 0 {
        let why = format!("{} pixels with NaN or Inf, or of halves that differ", prepared.found.missing_pixels);
        out.push(Skipped { what: "missing pixels".into(), why });
    }
    out
}

/// The whole report.
#[derive(Clone, Debug, Serialize)]
pub struct FitReport {
    /// Version of the program.
    pub version: String,
    /// Preset of the command line.
    pub preset: Preset,
    /// Seed of weights and tiles.
    pub seed: u64,
    /// Burn backend.
    pub backend: String,
    /// Instruction set of the kernels.
    pub instruction_set: &'static str,
    /// Threads of the run.
    pub threads: usize,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// What radiance was multiplied by.
    pub exposure: f32,
    /// What the picture is made of.
    pub composition: Composition,
    /// Share of the judged correction that was asked for, 0..1.
    pub strength: f32,
    /// Steps that were taken.
    pub steps: usize,
    /// Steps whose update was left out, since something of it was not finite.
    pub steps_dropped: usize,
    /// Why training ended.
    pub end: End,
    /// Against the reference, where there is one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rel_l2: Option<RelL2>,
    /// Self-supervised loss of both halves, the denoiser's and ours.
    pub loss: Losses,
    /// Estimated relL2 of the mean of both halves.
    pub estimate: Estimate,
    /// Fall of the loss by the pixels that training left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub held_out_gain: Option<Mean>,
    /// Why the output is the denoiser's, if it is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fallback: Option<String>,
    /// Mean share of the correction that was used, as local judgement and strength have it, 0..1.
    pub mean_share: f64,
    /// Mean weight of each network's correction; their sum is 1.
    pub network_weights: Vec<f64>,
    /// Mean share of what denoised passes make together in the correction, 0..1; absent without.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub composite_share: Option<f64>,
    /// Where the time went.
    pub seconds: FitSeconds,
    /// Milliseconds per training step.
    pub milliseconds_per_step: f64,
    /// Most memory that the process held, where the system tells.
    pub peak_rss_bytes: Option<u64>,
    /// Unusual pixels and features.
    pub found: Findings,
    /// What the halves say of each other.
    pub independence: Independence,
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
    /// What was left out, and why.
    pub skipped: Vec<Skipped>,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Neighbouring frames of a shot, and what was done with them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub neighbours: Vec<NeighbourReport>,
    /// Every setting, as training obeyed it.
    pub settings: Settings,
    /// Steps that were planned for this frame size, skips and visits considered.
    pub planned_steps: usize,
    /// Every training step.
    pub history: Vec<StepRecord>,
}
