//! The figures of a shot as a picture: error and flicker of every frame relative to the denoiser's, and JOD.

use crate::evaluate_shot::{FrameEvaluation, ShotDenoised, ShotEvaluation};
use crate::svg::{Line, Panel, plot};
use sspc_frames::sequence::Frames;
use sspc_metrics::video::jod;

// Okabe and Ito's colours, told apart by colour-blind readers.
const ERROR: &str = "#0072b2";
const FLICKER: &str = "#d55e00";
const PICTURE: &str = "#009e73";
const DENOISED: &str = "#666";

/// The plot's text, of a shot that was measured beside its denoised pictures.
pub fn svg(shot: &ShotEvaluation, frames: &Frames) -> String {
    let of_shot = |value: fn(&ShotDenoised) -> f64| shot.denoised.as_ref().map(value);
    let ratios = [
        line(shot, "relL2", ERROR, of_shot(|denoised| denoised.rel_l2_ratio), |frame| {
            frame.evaluation.denoised.as_ref().map(|denoised| denoised.rel_l2_ratio)
        }),
        line(shot, "temporal error", FLICKER, of_shot(|denoised| denoised.temporal_ratio), |frame| {
            let step = frame.temporal.as_ref()?;
            step.denoised.map(|denoised| step.picture / denoised)
        }),
    ];
    let jods = [
        line(shot, "pictures", PICTURE, Some(shot.jod), |frame| frame.jod.map(|jod| jod.picture)),
        line(shot, "denoised", DENOISED, of_shot(|denoised| denoised.jod), |frame| frame.jod?.denoised),
    ];
    let mut panels = vec![Panel {
        label: "÷ the denoiser's (lower is better)".to_string(),
        lines: ratios.into(),
        level: (1.0, "denoised"),
    }];
    if shot.jod.is_finite() {
        let label = "JOD (higher is better)".to_string();
        panels.push(Panel { label, lines: jods.into(), level: (jod(&[0.0]), "no visible difference") });
    }
    let viewing = &shot.viewing;
    let seen = format!(
        "JOD: {}, {}, {} frames per second, exposure {:.4}",
        viewing.metric, viewing.display, viewing.frames_per_second, viewing.exposure
    );
    plot(&format!("Error and flicker of frames {frames}"), &seen, "frame", &panels)
}

/// A line with a point for every frame that has a value.
fn line(
    shot: &ShotEvaluation,
    name: &str,
    colour: &'static str,
    mean: Option<f64>,
    value: impl Fn(&FrameEvaluation) -> Option<f64>,
) -> Line {
    let point = |frame: &FrameEvaluation| value(frame).map(|value| (f64::from(frame.frame), value));
    let mut points: Vec<_> = shot.frames.iter().filter_map(point).filter(|(_, value)| value.is_finite()).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    Line { name: name.to_string(), colour, points, mean: mean.filter(|mean| mean.is_finite()) }
}
