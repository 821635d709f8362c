//! What a fit leaves behind: corrected.exr, model.onnx, report.json, previews and, when asked for, the page.

use crate::cli::FitArgs;
use crate::fits::Fits;
use crate::fitted_model::fitted_model;
use crate::inputs::Input;
use crate::outcome::Outcome;
use crate::output_folder::OutputFolder;
use crate::page;
use crate::preset::Settings;
use crate::report::FitReport;
use rayon::prelude::*;
use sspc_cli::record::{self, peak_rss_bytes};
use sspc_cli::shot::settings::ShotSettings;
use sspc_cli::{Code, Failure, UnaskedModes};
use sspc_frames::atomic::{atomic_write_bytes, check_output};
use sspc_frames::preview::{Rgb8, error_map, strip, tone_map, write_png};
use sspc_frames::{OutputPlan, RoleOverrides};
use sspc_image::Image;
use sspc_kernels::features::FeatureSet;
use sspc_metrics::relative::rel_l2_map;
use sspc_onnx::{Model, write_network};
use std::ops::Range;
use std::path::PathBuf;
use std::time::Instant;

/// Name of the fitted network's file.
const MODEL: &str = "model.onnx";

/// What a fit writes down.
pub struct Written<'a> {
    /// As given.
    pub args: &'a FitArgs,
    /// How neighbouring frames take part, in a shot.
    pub shot: Option<ShotSettings>,
    /// As training obeyed them.
    pub settings: &'a Settings,
    /// The frames.
    pub inputs: &'a [Input],
    /// The model.
    pub fitted: &'a Fits,
    /// The pictures, one for each frame.
    pub outcomes: &'a [Outcome],
}

/// Whether every file may be written: worth asking before training.
///
/// # Errors
/// What stands in the way.
pub fn check_outputs(
    folder: &OutputFolder,
    args: &FitArgs,
    overrides: &RoleOverrides,
    inputs: &[Input],
) -> Result<(), Failure> {
    check_output(&folder.file(MODEL), &pictures_read(overrides, inputs))?;
    let protected = protected(args, overrides, inputs);
    pictures(inputs)?;
    if args.report {
        check_output(&folder.file(page::FILE), &protected)?;
    }
    for input in inputs {
        check_output(&folder.file(&input.frame_file_name("corrected", "exr")), &protected)?;
        let previews = preview_names(input).into_iter().map(|stem| (stem, "png"));
        for (stem, extension) in [("report", "json")].into_iter().chain(previews) {
            check_output(&folder.file(&input.file_name(stem, extension)), &protected)?;
        }
    }
    Ok(())
}

/// The files of corrected pictures: the inputs whose pictures go into each, and how.
fn pictures(inputs: &[Input]) -> Result<Vec<(Range<usize>, OutputPlan)>, Failure> {
    let mut files: Vec<(Range<usize>, OutputPlan)> = Vec::new();
    for (at, input) in inputs.iter().enumerate() {
        match files.pop() {
            Some((views, plan)) if inputs[views.start].is_of_frame(input) => {
                files.push((views.start..at + 1, plan.and(input.output.clone())?));
            }
            last => {
                files.extend(last);
                files.push((at..at + 1, input.output.clone()));
            }
        }
    }
    Ok(files)
}

/// Every picture that was read: frames and files named by roles.
fn pictures_read(overrides: &RoleOverrides, inputs: &[Input]) -> Vec<PathBuf> {
    inputs.iter().flat_map(|input| input.files.all()).chain(overrides.files()).collect()
}

/// What no output but the model may replace: the pictures and the model to start from. That one is read whole before
/// training and replaced by a rename, so it may be refined in place.
fn protected(args: &FitArgs, overrides: &RoleOverrides, inputs: &[Input]) -> Vec<PathBuf> {
    pictures_read(overrides, inputs).into_iter().chain(args.init.clone()).collect()
}

/// Writes everything; of a shot, names carry the frame's number.
///
/// # Errors
/// When a file cannot be written; none of them stays then.
pub fn write_outputs(
    what: &Written,
    overrides: &RoleOverrides,
    mut reports: Vec<FitReport>,
    mut folder: OutputFolder,
    start: Instant,
) -> Result<(), Failure> {
    let Written { args, inputs, outcomes, .. } = *what;
    let begin = Instant::now();
    let protected = protected(args, overrides, inputs);
    let model = write_network(&model(what)?);
    atomic_write_bytes(&folder.add(MODEL), &pictures_read(overrides, inputs), &model)?;
    // Compression takes longer than everything else here: all files of a frame at once.
    for (views, plan) in pictures(inputs)? {
        let (inputs, outcomes) = (&inputs[views.clone()], &outcomes[views]);
        let path = folder.add(&inputs[0].frame_file_name("corrected", "exr"));
        let mut shown: Vec<(PathBuf, Rgb8)> = Vec::new();
        for (input, outcome) in inputs.iter().zip(outcomes) {
            let names = previews(input, outcome).into_iter();
            shown.extend(names.map(|(stem, p)| (folder.add(&input.file_name(stem, "png")), p)));
        }
        let corrected: Vec<&Image> = outcomes.iter().flat_map(Outcome::pictures).collect();
        let provenance = provenance(what, &inputs[0], &outcomes[0]);
        let (written, shown) = rayon::join(
            || plan.write(&path, &protected, &corrected, &provenance),
            || shown.par_iter().try_for_each(|(path, preview)| write_png(path, &protected, preview)),
        );
        written?;
        shown?;
    }
    for (input, report) in inputs.iter().zip(&mut reports) {
        report.seconds.write = begin.elapsed().as_secs_f64();
        report.seconds.total = start.elapsed().as_secs_f64();
        report.peak_rss_bytes = peak_rss_bytes();
        let json = serde_json::to_vec_pretty(report)
            .map_err(|error| Failure::new(Code::Run, format!("cannot write the report: {error}"), ""))?;
        atomic_write_bytes(&folder.add(&input.file_name("report", "json")), &protected, &json)?;
    }
    if args.report {
        atomic_write_bytes(&folder.add(page::FILE), &protected, page::html(what, &reports)?.as_bytes())?;
    }
    folder.keep();
    Ok(())
}

/// The fitted networks with their contract.
fn model(&Written { shot, settings, inputs, fitted, .. }: &Written) -> Result<Model, Failure> {
    let features = inputs.iter().fold(FeatureSet::NONE, |all, input| all.union(input.features));
    let frames = inputs.iter().map(|i| i.name.clone()).collect();
    let with_differences = inputs.iter().any(|input| input.with_differences);
    let mut model = fitted_model(
        settings,
        fitted,
        features,
        with_differences,
        frames,
        concat!("sspc-train ", env!("CARGO_PKG_VERSION")),
    )?;
    if let Some(made) = &inputs[0].denoiser {
        model.contract.extra.insert(UnaskedModes::KEY.into(), made.kept().to_string());
    }
    // Without any neighbour the network has seen nothing but z.
    let has_neighbours = inputs.iter().flat_map(|input| &input.neighbours).any(|found| found.left_out.is_none());
    if let Some(shot) = shot.filter(|_| has_neighbours) {
        model.contract.extra_frames = shot.extra_frames;
        model.contract.extra.extend(shot.to_model());
    }
    Ok(model)
}

/// How the picture was made, for its attributes.
fn provenance(&Written { args, fitted, .. }: &Written, input: &Input, outcome: &Outcome) -> Vec<(String, String)> {
    let mut own = vec![
        ("sspc.preset", args.preset.to_string()),
        ("sspc.seed", args.seed.to_string()),
        ("sspc.steps", fitted.history.len().to_string()),
    ];
    own.extend(input.denoiser.iter().map(|made| ("sspc.denoiser", made.provenance())));
    record::provenance("sspc-train", &own, args.run.strength, outcome.verdict.fallback.as_deref())
}

/// Names of the pictures to look at: error maps where there is a reference, and last all of them side by side.
fn preview_names(input: &Input) -> Vec<&'static str> {
    let against_reference: &[&str] =
        if input.reference.is_some() { &["reference", "error-denoised", "error-corrected"] } else { &[] };
    let different: &[&str] = if input.shown_different.is_some() { &["halves-differ"] } else { &[] };
    [&["noisy", "denoised", "corrected"], different, against_reference, &["comparison"]].concat()
}

/// The pictures of [`preview_names`].
fn previews(input: &Input, outcome: &Outcome) -> Vec<(&'static str, Rgb8)> {
    let shown = |image: &Image| tone_map(image, input.shown_exposure);
    let mut pictures = vec![input.shown_noisy.clone(), shown(&input.denoised), shown(&outcome.corrected)];
    pictures.extend(input.shown_different.clone());
    if let Some(reference) = &input.reference {
        pictures.push(shown(&reference.mean));
        pictures.push(error_map(&rel_l2_map(&input.denoised, &reference.mean)));
        pictures.push(error_map(&rel_l2_map(&outcome.corrected, &reference.mean)));
    }
    pictures.push(strip(&pictures));
    preview_names(input).into_iter().zip(pictures).collect()
}
