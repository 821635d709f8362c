//! `evaluate` on a shot: every frame's figures, the temporal error of each step, JOD of the video, and all for the whole.

use crate::evaluate::{EvaluateArguments, Evaluation, Read, evaluate, json};
use crate::flicker::Flicker;
use crate::shot_plot;
use crate::shot_table::table;
use crate::shot_video::{self, Jod, Videos, Visible};
use serde::Serialize;
use sspc_cli::frame_args::pattern;
use sspc_cli::output::print_result;
use sspc_cli::{Code, Failure, interrupt};
use sspc_frames::atomic::{atomic_write_bytes, check_output};
use sspc_frames::preview::auto_exposure;
use sspc_frames::sequence::{Frames, Pattern};
use sspc_image::Image;
use sspc_metrics::video::{DISPLAY, MODEL, SMALLEST};
use std::path::PathBuf;

/// Everything `--json` prints.
#[derive(Debug, Serialize)]
pub struct ShotEvaluation {
    /// Each frame.
    pub frames: Vec<FrameEvaluation>,
    /// Mean relL2 over the frames.
    pub rel_l2: f64,
    /// Mean temporal error over the steps; `null` in JSON where no frame follows another.
    pub temporal: f64,
    /// Quality of the video in JOD, 10 at most; `null` in JSON where no frame follows another, and without JOD.
    pub jod: f64,
    /// The denoiser's pictures beside them, where they were given.
    pub denoised: Option<ShotDenoised>,
    /// What JOD was predicted for.
    pub viewing: Viewing,
    /// What was not measured.
    pub left_out: Vec<LeftOut>,
}

/// The denoiser's pictures of a shot.
#[derive(Debug, Serialize)]
pub struct ShotDenoised {
    /// Mean relL2 over the frames.
    pub rel_l2: f64,
    /// Mean temporal error over the steps.
    pub temporal: f64,
    /// Quality of the video in JOD.
    pub jod: f64,
    /// Mean relL2 over the denoiser's.
    pub rel_l2_ratio: f64,
    /// Mean temporal error over the denoiser's.
    pub temporal_ratio: f64,
    /// Mean over the frames of the ratio across the reference's halves; `null` in JSON where a reference has none.
    pub crossed_ratio: f64,
}

/// How a video was looked at.
#[derive(Debug, Serialize)]
pub struct Viewing {
    /// The metric and its version.
    pub metric: String,
    /// The display, by its name there.
    pub display: &'static str,
    /// Frames per second.
    pub frames_per_second: f32,
    /// Factor on radiance before the display curve, one for the shot.
    pub exposure: f32,
}

/// A figure that a frame does not have.
#[derive(Debug, Serialize)]
pub struct LeftOut {
    /// Its number.
    pub frame: i32,
    /// The figure's, as in [`FrameEvaluation`].
    pub figure: &'static str,
    /// The reason.
    pub why: String,
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
    /// Its quality within the video, where a frame follows it or it follows one.
    pub jod: Option<Jod>,
}

/// Runs the subcommand on a shot.
///
/// # Errors
/// A [`Failure`] with its exit code.
pub fn run(arguments: &EvaluateArguments, frames: &Frames) -> Result<(), Failure> {
    let shot = Shot::of(arguments, frames)?;
    if let Some(path) = &arguments.plot {
        if frames.as_slice().len() < 2 {
            let message = format!("--plot: expected at least 2 frames, found {frames}");
            return Err(Failure::new(Code::Arguments, message, "name more frames, or leave --plot out"));
        }
        check_output(path, &shot.inputs())?;
    }
    let exposure = match arguments.exposure {
        Some(exposure) => exposure,
        None => shot.exposure()?,
    };
    let measured = shot.measure(exposure)?;
    if let Some(path) = &arguments.plot {
        atomic_write_bytes(path, &shot.inputs(), shot_plot::svg(&measured, frames).as_bytes())?;
    }
    print_result(&if arguments.json { json(&measured)? } else { table(&measured) })
}

/// The files of a shot.
struct Shot<'a> {
    arguments: &'a EvaluateArguments,
    frames: &'a Frames,
    picture: Pattern,
    reference: Pattern,
    denoised: Option<Pattern>,
}

impl<'a> Shot<'a> {
    fn of(arguments: &'a EvaluateArguments, frames: &'a Frames) -> Result<Self, Failure> {
        let (picture, reference) = (pattern(&arguments.picture)?, pattern(&arguments.reference)?);
        let denoised = arguments.denoised.as_deref().map(pattern).transpose()?;
        Ok(Self { arguments, frames, picture, reference, denoised })
    }

    fn of_frame(&self, number: i32) -> EvaluateArguments {
        EvaluateArguments {
            picture: self.picture.path(number),
            reference: self.reference.path(number),
            denoised: self.denoised.as_ref().map(|pattern| pattern.path(number)),
            ..self.arguments.clone()
        }
    }

    fn inputs(&self) -> Vec<PathBuf> {
        let patterns = || [&self.picture, &self.reference].into_iter().chain(&self.denoised);
        self.frames.into_iter().flat_map(|number| patterns().map(move |pattern| pattern.path(number))).collect()
    }

    /// The median of what the frames would have by themselves, so that fades stay what they are.
    fn exposure(&self) -> Result<f32, Failure> {
        let of_frame = |number| {
            interrupt::check()?;
            Ok(auto_exposure(&self.of_frame(number).read_reference(None)?.mean))
        };
        let mut exposures: Vec<f32> = self.frames.into_iter().map(of_frame).collect::<Result<_, Failure>>()?;
        exposures.sort_by(f32::total_cmp);
        Ok(exposures[exposures.len() / 2])
    }

    fn measure(&self, exposure: f32) -> Result<ShotEvaluation, Failure> {
        let mut videos = Videos::new(self.arguments.fps, exposure);
        let (mut frames, mut left_out) = (Vec::new(), Vec::new());
        let mut before: Option<(i32, Read)> = None;
        for number in self.frames {
            interrupt::check()?;
            let of_frame = EvaluateArguments { exposure: Some(exposure), ..self.of_frame(number) };
            let read = Read::of(&of_frame)?;
            let evaluation = evaluate(&of_frame, &read.picture, &read.reference, read.denoised.as_ref())?;
            let cut = before.as_ref().and_then(|(last, before)| cut(*last, before, number, &read));
            let last = before.as_ref().filter(|_| cut.is_none());
            let temporal = last.map(|(_, before)| Flicker::of(read.measured(), before.measured()));
            if !self.arguments.no_jod {
                videos.push(&read, last.is_some())?;
            }
            left_out.extend(cut.map(|why| LeftOut { frame: number, figure: "temporal", why }));
            frames.push(FrameEvaluation { frame: number, evaluation, temporal, jod: None });
            before = Some((number, read));
        }
        let visible = videos.finish()?;
        for (frame, visible) in frames.iter_mut().zip(&visible) {
            frame.jod = shot_video::of_frame(visible);
            left_out.extend(frame.jod.is_none().then(|| unseen(frame)));
        }
        let viewing = Viewing {
            metric: format!("ColorVideoVDP {MODEL}"),
            display: DISPLAY,
            frames_per_second: self.arguments.fps,
            exposure,
        };
        Ok(whole(frames, &visible, viewing, left_out))
    }
}

/// Why a frame does not go on where the last one was.
fn cut(last: i32, before: &Read, number: i32, now: &Read) -> Option<String> {
    let size = |image: &Image| format!("{}x{}", image.width(), image.height());
    if last.checked_add(1) != Some(number) {
        return Some(format!("frame {last} is before it"));
    }
    let same = before.picture.same_size(&now.picture);
    (!same).then(|| format!("{} pixels, frame {last} before it {}", size(&now.picture), size(&before.picture)))
}

fn unseen(frame: &FrameEvaluation) -> LeftOut {
    let Evaluation { width, height, .. } = frame.evaluation;
    let why = match width.min(height) < SMALLEST {
        true => format!("{width}x{height} pixels, fewer than {SMALLEST} to a side"),
        false => "it neither follows a frame nor is followed".to_string(),
    };
    LeftOut { frame: frame.frame, figure: "jod", why }
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0.0), |(sum, count), value| (sum + value, count + 1.0));
    sum / count
}

fn whole(
    frames: Vec<FrameEvaluation>,
    visible: &[Visible],
    viewing: Viewing,
    left_out: Vec<LeftOut>,
) -> ShotEvaluation {
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
            jod: shot_video::of_shot(visible, 1),
            rel_l2_ratio: rel_l2 / own,
            temporal_ratio: temporal / own_temporal,
            crossed_ratio: mean(beside.iter().map(|denoised| denoised.crossed_ratio)),
        }
    });
    let jod = shot_video::of_shot(visible, 0);
    ShotEvaluation { frames, rel_l2, temporal, jod, denoised, viewing, left_out }
}
