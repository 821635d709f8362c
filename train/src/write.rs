//! What a fit leaves behind: corrected.exr, model.onnx, report.json and previews.

use crate::cli::FitArgs;
use crate::error::Error;
use crate::fit::Fitted;
use crate::fit_command::Outcome;
use crate::inputs::Input;
use crate::output::OutputFolder;
use crate::preset::Settings;
use crate::report::{Report, peak_rss_bytes};
use rayon::prelude::*;
use sspc_frames::atomic::{atomic_write_bytes, check_output};
use sspc_frames::preview::{Rgb8, error_map, strip, tone_map, write_png};
use sspc_frames::{RoleOverrides, write_corrected};
use sspc_image::Image;
use sspc_kernels::features::FeatureSet;
use sspc_metrics::relative::rel_l2_map;
use sspc_onnx::{Contract, Model, write_network};
use std::path::PathBuf;
use std::time::Instant;

/// Name of the fitted network's file.
const MODEL: &str = "model.onnx";

/// Whether every file may be written: worth asking before training.
pub fn check_outputs(folder: &OutputFolder, args: &FitArgs, inputs: &[Input]) -> Result<(), Error> {
    check_output(&folder.file(MODEL), &images(args, inputs)?)?;
    let protected = protected(args, inputs)?;
    for input in inputs {
        let previews = preview_names(input).into_iter().map(|stem| (stem, "png"));
        for (stem, extension) in [("corrected", "exr"), ("report", "json")].into_iter().chain(previews) {
            check_output(&folder.file(&input.file_name(stem, extension)), &protected)?;
        }
    }
    Ok(())
}

/// Every picture that was read: frames and files named by roles.
fn images(args: &FitArgs, inputs: &[Input]) -> Result<Vec<PathBuf>, Error> {
    let frames = inputs.iter().flat_map(|input| input.files.all());
    Ok(frames.chain(RoleOverrides::parse(&args.roles)?.files()).collect())
}

/// What no output but the model may replace: the pictures and the model to start from. That one is read whole before
/// training and replaced by a rename, so it may be refined in place.
fn protected(args: &FitArgs, inputs: &[Input]) -> Result<Vec<PathBuf>, Error> {
    Ok(images(args, inputs)?.into_iter().chain(args.init.clone()).collect())
}

/// Writes everything; of a shot, names carry the frame's number.
#[allow(clippy::too_many_arguments)] // the whole of a run ends here
pub fn write_outputs(
    args: &FitArgs,
    settings: &Settings,
    inputs: &[Input],
    fitted: &Fitted,
    results: &[Outcome],
    mut reports: Vec<Report>,
    mut folder: OutputFolder,
    start: Instant,
) -> Result<(), Error> {
    let begin = Instant::now();
    let protected = protected(args, inputs)?;
    let model = write_network(&model(args, settings, inputs, fitted)?);
    atomic_write_bytes(&folder.add(MODEL), &images(args, inputs)?, &model)?;
    // Compression takes longer than everything else here: all files of a frame at once.
    for (input, result) in inputs.iter().zip(results) {
        let picture = folder.add(&input.file_name("corrected", "exr"));
        let previews: Vec<(PathBuf, Rgb8)> = previews(input, result)
            .into_iter()
            .map(|(stem, p)| (folder.add(&input.file_name(stem, "png")), p))
            .collect();
        let provenance = provenance(args, fitted, result);
        let (written, shown) = rayon::join(
            || write_corrected(&picture, &input.files.a, &protected, &result.corrected, &provenance),
            || previews.par_iter().try_for_each(|(path, preview)| write_png(path, &protected, preview)),
        );
        written?;
        shown?;
    }
    for (input, report) in inputs.iter().zip(&mut reports) {
        report.seconds.write = begin.elapsed().as_secs_f64();
        report.seconds.total = start.elapsed().as_secs_f64();
        report.peak_rss_bytes = peak_rss_bytes();
        let json = serde_json::to_vec_pretty(report).map_err(Error::Report)?;
        atomic_write_bytes(&folder.add(&input.file_name("report", "json")), &protected, &json)?;
    }
    folder.keep();
    Ok(())
}

/// The fitted network with its contract.
fn model(args: &FitArgs, settings: &Settings, inputs: &[Input], fitted: &Fitted) -> Result<Model, Error> {
    let mut contract = Contract::new(settings.form);
    contract.shape = settings.shape;
    contract.window_radius = settings.radius;
    contract.exposure = settings.exposure;
    contract.composition = settings.composition;
    contract.features = inputs.iter().fold(FeatureSet::NONE, |all, input| all.union(input.features));
    contract.seed = args.seed;
    contract.frames = inputs.iter().map(|i| i.name.clone()).collect();
    contract.tool = concat!("sspc-train ", env!("CARGO_PKG_VERSION")).into();
    contract.preset = args.preset.to_string();
    contract.steps = fitted.history.len() as u64;
    if !settings.changes.is_empty() {
        contract.extra.insert("settings_changed".into(), settings.changes.join(" "));
    }
    Ok(Model::new(contract, fitted.network.weights.clone())?)
}

/// How the picture was made, for its EXR attributes.
fn provenance(args: &FitArgs, fitted: &Fitted, result: &Outcome) -> Vec<(String, String)> {
    let fallback = result.fallback.clone().unwrap_or_else(|| "none".into());
    [
        ("sspc.tool", concat!("sspc-train ", env!("CARGO_PKG_VERSION")).to_string()),
        ("sspc.preset", args.preset.to_string()),
        ("sspc.seed", args.seed.to_string()),
        ("sspc.steps", fitted.history.len().to_string()),
        ("sspc.strength", args.strength.to_string()),
        ("sspc.fallback", fallback),
    ]
    .map(|(key, value)| (key.to_string(), value))
    .to_vec()
}

/// Names of the pictures to look at: error maps where there is a reference, and last all of them side by side.
fn preview_names(input: &Input) -> Vec<&'static str> {
    let against_reference: &[&str] =
        if input.reference.is_some() { &["reference", "error-denoised", "error-corrected"] } else { &[] };
    [&["noisy", "denoised", "corrected"], against_reference, &["comparison"]].concat()
}

/// The pictures of [`preview_names`].
fn previews(input: &Input, result: &Outcome) -> Vec<(&'static str, Rgb8)> {
    let shown = |image: &Image| tone_map(image, input.shown_exposure);
    let mut pictures = vec![input.shown_noisy.clone(), shown(&input.denoised), shown(&result.corrected)];
    if let Some(reference) = &input.reference {
        pictures.push(shown(&reference.mean));
        pictures.push(error_map(&rel_l2_map(&input.denoised, &reference.mean)));
        pictures.push(error_map(&rel_l2_map(&result.corrected, &reference.mean)));
    }
    pictures.push(strip(&pictures));
    preview_names(input).into_iter().zip(pictures).collect()
}
