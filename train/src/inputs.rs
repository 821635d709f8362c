//! From the command line to frames: files, roles, references; and what is kept of a frame as read.

use crate::cli::FitArgs;
use crate::error::Error;
use crate::preset::Settings;
use crate::report::{Rivals, Skipped, skipped};
use sspc_core::fill::values_from_sources;
use sspc_core::prepare::{Prepared, Survey, baseline};
use sspc_frames::preview::{Rgb8, auto_exposure, tone_map};
use sspc_frames::read::Like;
use sspc_frames::sequence::{Frames, Pattern};
use sspc_frames::{FrameFiles, RoleOverrides, read_frame, read_reference};
use sspc_image::{Frame, Image, Reference, RoleSource};
use sspc_kernels::features::FeatureSet;
use std::path::PathBuf;

/// One frame of the fit: what is needed of it beside the features. The frame itself is gone once it is
/// prepared, which halves the memory of a fit.
pub struct Input {
    pub name: String,
    /// Number in a shot.
    pub frame_number: Option<u32>,
    pub files: FrameFiles,
    /// Which channel filled which role, in the order read.
    pub sources: Vec<RoleSource>,
    pub warnings: Vec<String>,
    pub survey: Survey,
    /// Features in use.
    pub features: FeatureSet,
    pub skipped: Vec<Skipped>,
    /// The picture that the correction is added to, in the frame's units, `[3, H, W]`.
    pub denoised: Image,
    /// Values of its missing pixels, by their index.
    pub fill: Vec<(usize, [f32; 3])>,
    /// Exposure of previews.
    pub shown_exposure: f32,
    /// The mean of both halves' radiance, to look at.
    pub shown_noisy: Rgb8,
    pub reference: Option<Reference>,
    /// What the corrected picture is measured beside, where there is a reference.
    pub rivals: Option<Rivals>,
}

impl Input {
    /// Name of an output of this frame.
    pub fn file_name(&self, stem: &str, extension: &str) -> String {
        match self.frame_number {
            Some(number) => format!("{stem}.{number}.{extension}"),
            None => format!("{stem}.{extension}"),
        }
    }
}

/// The files of the frame that the arguments name.
pub fn frame_files(args: &FitArgs) -> Result<FrameFiles, Error> {
    let files = match (&args.a_file, &args.b_file, &args.paper_layout) {
        (Some(a), Some(b), _) => FrameFiles::halves(a, b),
        (Some(both), None, _) => FrameFiles::both_in_one(both),
        (None, _, Some(root)) => {
            let missing = || Error::Arguments("--paper-layout needs --scene, --spp and --denoiser".into());
            let scene = args.scene.as_deref().ok_or_else(missing)?;
            let denoiser = args.denoiser.as_deref().ok_or_else(missing)?;
            FrameFiles::paper_layout(root, scene, args.spp.ok_or_else(missing)?, denoiser)?
        }
        (None, _, None) => return Err(Error::Arguments("give two half buffers, --paper-layout or a shot".into())),
    };
    Ok(files
        .with_denoised(args.denoised_a.clone(), args.denoised_b.clone(), args.denoised.clone())
        .with_reference(args.reference.clone()))
}

/// Reads one frame and its reference, and prepares it.
pub fn read(files: FrameFiles, overrides: &RoleOverrides, settings: &Settings) -> Result<(Input, Prepared), Error> {
    let mut frame = read_frame(&files, overrides)?;
    let like = Like { image: &frame.a.radiance, path: &files.a };
    let reference = files.reference.as_ref().map(|path| read_reference(path, Some(like))).transpose()?;
    let survey = Survey::of(&frame, settings.exposure).with_features_of(settings.features);
    let sources = std::mem::take(&mut frame.sources);
    let warnings = std::mem::take(&mut frame.warnings);
    let (fill, shown_exposure, shown_noisy, rivals) = {
        let denoised = baseline(&frame);
        let noisy = Image::mean_of(&frame.a.radiance, &frame.b.radiance);
        let missing = survey.found.missing_pixels > 0;
        let fill = if missing { values_from_sources(&denoised, &frame) } else { Vec::new() };
        let exposure = auto_exposure(&denoised);
        let halves = || Image::mean_of(&frame.a.denoised, &frame.b.denoised);
        let rivals = reference.as_ref().map(|r| Rivals::measure(&noisy, &denoised, (!missing).then(halves), r));
        (fill, exposure, tone_map(&noisy, exposure), rivals)
    };
    let (prepared, denoised) = prepare(frame, survey, settings);
    let input = Input {
        name: files.a.display().to_string(),
        frame_number: None,
        files,
        sources,
        warnings,
        survey,
        features: prepared.set,
        skipped: skipped(&prepared),
        denoised,
        fill,
        shown_exposure,
        shown_noisy,
        reference,
        rivals,
    };
    Ok((input, prepared))
}

/// A frame in the method's units, with the features and the skips that the settings allow. Features
/// kept without need stay zeros, so that the picture is the same.
fn prepare(frame: Frame, survey: Survey, settings: &Settings) -> (Prepared, Image) {
    let (mut prepared, denoised) = Prepared::of_owned(frame, survey);
    if !settings.composition.skips_still_blocks() || !settings.skip.blocks {
        prepared = prepared.without_skips(survey);
    }
    if !settings.skip.features {
        prepared.set = settings.features;
    }
    (prepared, denoised)
}

/// Reads the frames of a shot that the arguments name, each with its files of the same number.
pub fn read_shot(
    args: &FitArgs,
    overrides: &RoleOverrides,
    settings: &Settings,
) -> Result<Vec<(Input, Prepared)>, Error> {
    let missing = || Error::Arguments("a shot needs --a, --b and --frames".into());
    let a: Pattern = args.a.as_deref().ok_or_else(missing)?.parse()?;
    let b: Pattern = args.b.as_deref().ok_or_else(missing)?.parse()?;
    let frames: Frames = args.frames.as_deref().ok_or_else(missing)?.parse()?;
    let of_frame = |path: &Option<PathBuf>, number: u32| match path {
        None => Ok(None),
        Some(path) => path.display().to_string().parse::<Pattern>().map(|p| Some(p.path(number))),
    };
    let mut inputs = Vec::new();
    for &number in frames.as_slice() {
        let files = FrameFiles::halves(a.path(number), b.path(number))
            .with_denoised(
                of_frame(&args.denoised_a, number)?,
                of_frame(&args.denoised_b, number)?,
                of_frame(&args.denoised, number)?,
            )
            .with_reference(of_frame(&args.reference, number)?);
        let (input, prepared) = read(files, overrides, settings)?;
        inputs.push((Input { frame_number: Some(number), ..input }, prepared));
    }
    Ok(inputs)
}
