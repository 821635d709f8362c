//! From the command line to frames: files, roles, references; and what is kept of a frame as read.

use crate::preset::Settings;
use crate::report::{Rivals, Skipped, skipped};
use sspc_cli::passes::{FramePasses, PassArgs};
use sspc_cli::reading::{ReadFrame, Source};
use sspc_cli::shot::report::NeighbourReport;
use sspc_cli::shot::{Residence, Shot, ShotFrame};
use sspc_cli::{DenoiserReport, Denoising, Failure, FrameJob};
use sspc_core::differences::Differences;
use sspc_core::fill::values_from_sources;
use sspc_core::frame_stats::FrameStats;
use sspc_core::prepare::{Prepared, baseline};
use sspc_frames::overrides::Choice;
use sspc_frames::preview::{Rgb8, auto_exposure, spotlight, tone_map};
use sspc_frames::read::Like;
use sspc_frames::samples::HalfSamples;
use sspc_frames::{FrameFiles, OpenFrame, OutputPlan, RoleOverrides, read_reference};
use sspc_image::{Buffer, Frame, Image, Reference, Role, RoleSource};
use sspc_kernels::features::FeatureSet;
use std::sync::Arc;

/// One frame of the fit: what is needed of it beside the features. The frame itself is gone once it is
/// prepared, which halves the memory of a fit.
pub struct Input {
    /// What messages and the model call it.
    pub name: String,
    /// Number in a shot.
    pub frame_number: Option<i32>,
    /// Its additive passes, where they are asked for.
    pub passes: Option<FramePasses>,
    /// The view, where all of them are corrected.
    pub view: Option<String>,
    /// Its files.
    pub files: FrameFiles,
    /// Where its picture goes.
    pub output: OutputPlan,
    /// Which channel filled which role, in the order read.
    pub roles: Vec<RoleSource>,
    /// The samples of each half.
    pub samples: HalfSamples,
    /// Which denoised pictures were made, where the files do not hold them.
    pub denoiser: Option<DenoiserReport>,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Neighbouring frames of a shot, and what was done with them.
    pub neighbours: Vec<NeighbourReport>,
    /// What was decided for the whole frame.
    pub stats: FrameStats,
    /// Features in use.
    pub features: FeatureSet,
    /// Whether differences of y are in use.
    pub with_differences: bool,
    /// What is left out, and why.
    pub skipped: Vec<Skipped>,
    /// The picture that the correction is added to, in the frame's units, `[3, H, W]`.
    pub denoised: Image,
    /// Values of its missing pixels, by their index.
    pub fill: Vec<(usize, [f32; 3])>,
    /// Exposure of previews.
    pub shown_exposure: f32,
    /// The mean of both halves' radiance by their weights, to look at.
    pub shown_noisy: Rgb8,
    /// The reference, where one was given.
    pub reference: Option<Reference>,
    /// Where the halves show different things, to look at.
    pub shown_different: Option<Rgb8>,
    /// What the corrected picture is measured beside, where there is a reference.
    pub rivals: Option<Rivals>,
}

impl Input {
    /// Name of an output of this frame.
    pub fn file_name(&self, stem: &str, extension: &str) -> String {
        match &self.view {
            Some(view) => self.frame_file_name(&format!("{stem}.{}", file_text(view)), extension),
            None => self.frame_file_name(stem, extension),
        }
    }

    /// Name of an output of all views of this frame together.
    pub fn frame_file_name(&self, stem: &str, extension: &str) -> String {
        match self.frame_number {
            Some(number) => format!("{stem}.{number}.{extension}"),
            None => format!("{stem}.{extension}"),
        }
    }

    /// Whether both are views of one frame, whose pictures go into one file.
    pub fn is_of_frame(&self, other: &Input) -> bool {
        self.view.is_some() && self.files == other.files
    }
}

/// A view's name as a part of a file's name.
fn file_text(view: &str) -> String {
    view.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect()
}

/// Reads one frame and its reference, and prepares it; what its files do not hold is denoised first. One of a `shot` comes
/// with its neighbours.
///
/// # Errors
/// What reading a file can raise, halves that cannot be used, and no denoiser where one is needed.
pub fn read(
    job: FrameJob,
    shot: Option<&Shot>,
    overrides: &RoleOverrides,
    settings: &Settings,
    denoising: &Denoising,
    passes: &PassArgs,
) -> Result<(Input, Prepared), Failure> {
    let FrameJob { number, files } = job;
    let with_differences = settings.difference_strength > 0.0;
    let overrides = &if with_differences { overrides.clone().with_differences() } else { overrides.clone() };
    let in_shot = shot.zip(number);
    let mut open = match in_shot {
        Some((shot, number)) => shot.open(number, overrides)?,
        None => OpenFrame::open_to_denoise(&files, overrides)?,
    };
    let mut said: Vec<String> = open.note_on_differences().into_iter().collect();
    let is_named = |role| {
        [Buffer::A, Buffer::B].iter().any(|half| matches!(overrides.get(role, *half), Some(Choice::From { .. })))
    };
    if !with_differences && Role::DIFFERENCES.into_iter().any(is_named) {
        said.push("dx and dy are named and not used: --set differences=1 trains on them".to_string());
    }
    let mut output = open.output()?;
    let mut passes = passes.find(&open, denoising)?;
    if let Some(passes) = &passes {
        output = output.and(passes.output()?)?;
    }
    let like = Like { path: &files.a, placing: open.placing() };
    let ShotFrame { frame, denoiser, neighbours } = match in_shot {
        Some((shot, number)) => shot.read(number, open, overrides, settings.exposure, Residence::Memory)?,
        None => {
            let denoiser = denoising.supply(&mut open)?;
            ShotFrame { frame: ReadFrame::held(&open, settings.exposure)?, denoiser, neighbours: Vec::new() }
        }
    };
    let ReadFrame { mut source, stats, roles, samples, mut warnings, different } = frame;
    if let Some(composite) = passes.as_mut().and_then(FramePasses::take_composite) {
        source.set_composite(composite);
    }
    let Source::Held(frame) = source else { unreachable!("a frame that is held") };
    let reference = files.reference.as_ref().map(|path| read_reference(path, Some(like))).transpose()?;
    let stats = stats.with_features_of(settings.features);
    let (fill, shown_exposure, shown_noisy, rivals) = {
        let denoised = baseline(&frame);
        let noisy = frame.weights.mean_of(&frame.a.radiance, &frame.b.radiance);
        let missing = stats.found.missing_pixels > 0;
        let fill = if missing { values_from_sources(&denoised, &frame) } else { Vec::new() };
        let exposure = auto_exposure(&denoised);
        let halves = || frame.weights.mean_of(&frame.a.denoised, &frame.b.denoised);
        let rivals = reference.as_ref().map(|r| Rivals::measure(&noisy, &denoised, (!missing).then(halves), r));
        (fill, exposure, tone_map(&noisy, exposure), rivals)
    };
    let shown_different = different.map(|places| {
        let ground = baseline(&frame);
        spotlight(&ground, &places.map(ground.height(), ground.width()), shown_exposure)
    });
    let (prepared, denoised, of_differences) = prepare(*frame, &stats, settings);
    said.extend(of_differences);
    warnings.extend(said);
    let input = Input {
        name: files.a.display().to_string(),
        frame_number: number,
        view: overrides.view().filter(|_| overrides.all_views()).map(str::to_string),
        files,
        passes,
        output,
        roles,
        samples,
        denoiser,
        warnings,
        neighbours,
        stats,
        features: prepared.set,
        with_differences: prepared.differences.is_some(),
        skipped: skipped(&prepared),
        denoised,
        fill,
        shown_exposure,
        shown_noisy,
        reference,
        shown_different,
        rivals,
    };
    Ok((input, prepared))
}

/// A frame in the method's units, with the features and the skips that the settings allow; and the picture `[3, H, W]`
/// that its correction is added to, in the frame's own; and what a person should know of differences of y, where the settings
/// use them. Features kept without need stay zeros, so that the picture is the same.
pub fn prepare(mut frame: Frame, stats: &FrameStats, settings: &Settings) -> (Prepared, Image, Vec<String>) {
    let (differences, strength, mut said) = (frame.differences.take(), settings.difference_strength, Vec::new());
    if differences.is_some() && strength == 0.0 {
        said.push("dx and dy are given and not used: the setting differences=1 trains on them".to_string());
    }
    let (mut prepared, denoised) = Prepared::of_owned(frame, stats);
    if let Some(read) = differences.filter(|_| strength > 0.0) {
        let (differences, notes) = Differences::new(&read, &prepared, strength);
        prepared.differences = differences.map(Arc::new);
        said = notes;
    }
    if !settings.composition.skips_still_blocks() || !settings.skip.blocks {
        prepared = prepared.without_skips(stats);
    }
    if !settings.skip.features {
        prepared.set = settings.features;
    }
    (prepared, denoised, said)
}
