//! `evaluate` on a shot: every frame's figures, the temporal error of each step, and both for the whole.

use crate::evaluate::{EvaluateArguments, Evaluation, Read, evaluate, json};
use crate::flicker::Flicker;
use serde::Serialize;
use sspc_cli::frame_args::pattern;
use sspc_cli::output::print_result;
use sspc_cli::{Failure, interrupt};
use sspc_frames::sequence::Frames;

/// Everything `--json` prints.
#[derive(Debug, Serialize)]
pub struct ShotEvaluation {
    /// Each frame.
    pub frames: Vec<FrameEvaluation>,
    /// Mean relL2 over the frames.
    pub rel_l2: f64,
    /// Mean temporal error over the steps; `null` in JSON where no frame follows another.
    pub temporal: f64,
    /// The denoiser's pictures beside them, where they were given.
    pub denoised: Option<ShotDenoised>,
}

/// The denoiser's pictures of a shot.
#[derive(Debug, Serialize)]
pub struct ShotDenoised {
    /// Mean relL2 over the frames.
    pub rel_l2: f64,
    /// Mean temporal error over the steps.
    pub temporal: f64,
    /// Mean relL2 over the denoiser's.
    pub rel_l2_ratio: f64,
    /// Mean temporal error over the denoiser's.
    pub temporal_ratio: f64,
    /// Mean over the frames of the ratio across the reference's halves; `null` in JSON where a reference has none.
    pub crossed_ratio: f64,
}

/// One frame of a shot.
#[derive(Debug, Serialize)]
pub struct FrameEvaluation {
    /// Its number.
    pub frame: i32,
    /// As of a single frame.
    #[serde(flatten)]
    pub evaluation: Evaluation,
    /// The change from the frame before, where that is a frame of the shot.
    pub temporal: Option<Flicker>,
}

/// Runs the subcommand on a shot.
///
/// # Errors
/// A [`Failure`] with its exit code.
pub fn run(arguments: &EvaluateArguments, frames: &Frames) -> Result<(), Failure> {
    let (picture, reference) = (pattern(&arguments.picture)?, pattern(&arguments.reference)?);
    let denoised = arguments.denoised.as_deref().map(pattern).transpose()?;
    let mut evaluations: Vec<FrameEvaluation> = Vec::new();
    let mut before: Option<(i32, Read)> = None;
    for &number in frames.as_slice() {
        interrupt::check()?;
        let of_frame = EvaluateArguments {
            picture: picture.path(number),
            reference: reference.path(number),
            denoised: denoised.as_ref().map(|pattern| pattern.path(number)),
            ..arguments.clone()
        };
        let read = Read::of(&of_frame)?;
        let evaluation = evaluate(&of_frame, &read.picture, &read.reference, read.denoised.as_ref())?;
        let last = before.as_ref().filter(|(last, read_before)| {
            last.checked_add(1) == Some(number) && read_before.picture.same_size(&read.picture)
        });
        let temporal = last.map(|(_, before)| Flicker::of(read.measured(), before.measured()));
        evaluations.push(FrameEvaluation { frame: number, evaluation, temporal });
        before = Some((number, read));
    }
    let shot = whole(evaluations);
    print_result(&if arguments.json { json(&shot)? } else { table(&shot) })
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

fn whole(frames: Vec<FrameEvaluation>) -> ShotEvaluation {
    let rel_l2 = mean(frames.iter().map(|frame| frame.evaluation.figures.rel_l2));
    let steps = || frames.iter().filter_map(|frame| frame.temporal.as_ref());
    let temporal = mean(steps().map(|step| step.picture));
    let beside: Option<Vec<_>> = frames.iter().map(|frame| frame.evaluation.denoised.as_ref()).collect();
    let denoised = beside.map(|beside| {
        let own = mean(beside.iter().map(|denoised| denoised.figures.rel_l2));
        let own_temporal = mean(steps().filter_map(|step| step.denoised));
        ShotDenoised {
            rel_l2: own,
            temporal: own_temporal,
            rel_l2_ratio: rel_l2 / own,
            temporal_ratio: temporal / own_temporal,
            crossed_ratio: mean(beside.iter().map(|denoised| denoised.crossed_ratio)),
        }
    });
    ShotEvaluation { frames, rel_l2, temporal, denoised }
}

fn table(shot: &ShotEvaluation) -> String {
    let mut text = format!(
        "{:<8} {:>10} {:>7} {:>10} {:>7} {:>7} {:>7}\n",
        "frame", "relL2", "ratio", "temporal", "ratio", "SSIM", "FLIP"
    );
    let ratio = |value: Option<f64>| value.map_or("-".to_string(), |value| format!("{value:.3}"));
    for frame in &shot.frames {
        let figures = &frame.evaluation.figures;
        let own = frame.evaluation.denoised.as_ref().map(|denoised| denoised.rel_l2_ratio);
        let step = frame.temporal.as_ref();
        let temporal = step.map_or("-".to_string(), |step| format!("{:.6}", step.picture));
        let of_step = ratio(step.and_then(|step| step.denoised.map(|denoised| step.picture / denoised)));
        text += &format!(
            "{:<8} {:>10.6} {:>7} {temporal:>10} {of_step:>7} {:>7.4} {:>7.4}\n",
            frame.frame,
            figures.rel_l2,
            ratio(own),
            figures.ssim,
            figures.flip
        );
    }
    let of_shot = |value: fn(&ShotDenoised) -> f64| ratio(shot.denoised.as_ref().map(value));
    let temporal = if shot.temporal.is_finite() { format!("{:.6}", shot.temporal) } else { "-".to_string() };
    text += &format!(
        "{:<8} {:>10.6} {:>7} {temporal:>10} {:>7}\n",
        "shot",
        shot.rel_l2,
        of_shot(|denoised| denoised.rel_l2_ratio),
        of_shot(|denoised| denoised.temporal_ratio)
    );
    text
}
