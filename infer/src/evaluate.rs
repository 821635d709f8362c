//! `evaluate`: a picture, and the denoiser's beside it, measured against a reference; or those of a shot.

use crate::evaluate_shot;
use crate::flicker::Measured;
use clap::Args;
use serde::Serialize;
use sspc_cli::interrupt;
use sspc_cli::output::print_result;
use sspc_cli::{Code, Failure};
use sspc_frames::atomic::check_output;
use sspc_frames::preview::{self, auto_exposure};
use sspc_frames::read::{Like, read_placed_layer, read_placed_picture, read_reference_layer};
use sspc_frames::read_reference;
use sspc_image::{Image, Reference};
use sspc_metrics::relative::rel_l2_map;
use sspc_metrics::video::MOST_FRAMES_PER_SECOND;
use sspc_metrics::{Comparison, Figures, figures};
use std::path::{Path, PathBuf};

/// What `evaluate` is told.
#[derive(Clone, Debug, Args)]
pub struct EvaluateArguments {
    /// The picture to measure (its R,G,B, Combined or Beauty; a pattern for a shot, as are reference and denoised)
    #[arg(value_name = "X.exr")]
    pub picture: PathBuf,

    /// The reference; with layers a.* and b.* of two independent halves its own noise is taken out of relL2
    #[arg(long, value_name = "REF.exr")]
    pub reference: PathBuf,

    /// The denoiser's picture, measured beside it
    #[arg(long, value_name = "Z.exr")]
    pub denoised: Option<PathBuf>,

    /// Measure this layer of every file instead of its colour: a pass, e.g. 'ViewLayer.Diffuse Direct' or RGBA_key. The reference's
    /// layers a.NAME and b.NAME are its halves; a file that has R,G,B alone is taken as the layer
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,

    /// Frames of a shot, e.g. 1001-1040: every figure for each frame and for the shot, the temporal error, and JOD of
    /// ColorVideoVDP
    #[arg(long, value_name = "RANGE", conflicts_with = "error_map", allow_hyphen_values = true)]
    pub frames: Option<String>,

    /// Frames per second of a shot, for JOD
    #[arg(long, value_name = "N", default_value_t = 24.0, value_parser = rate, requires = "frames")]
    pub fps: f32,

    /// Leave JOD out, which takes most of the time and memory of large pictures
    #[arg(long, requires = "frames", conflicts_with = "fps")]
    pub no_jod: bool,

    /// Draw every frame's error and flicker relative to the denoiser's, and JOD, as SVG
    #[arg(long, value_name = "SVG", requires = "frames", requires = "denoised")]
    pub plot: Option<PathBuf>,

    /// Factor on radiance before the display curve of PSNR, SSIM, FLIP and JOD [default: puts the geometric mean of the
    /// reference's luminance at middle grey, 0.18; of a shot the median of its frames' factors]
    #[arg(long, value_name = "FACTOR", value_parser = positive)]
    pub exposure: Option<f32>,

    /// Write the picture's error, (x - r)^2 / (mean(r)^2 + 0.01), in colours from 1e-4 (black) to 1 (pale yellow)
    #[arg(long, value_name = "PNG")]
    pub error_map: Option<PathBuf>,

    /// Print JSON with every figure
    #[arg(long)]
    pub json: bool,
}

fn positive(text: &str) -> Result<f32, String> {
    let value: f32 = text.parse().map_err(|_| "expected a number".to_string())?;
    if value.is_finite() && value > 0.0 { Ok(value) } else { Err("expected a number above 0".to_string()) }
}

fn rate(text: &str) -> Result<f32, String> {
    let most = MOST_FRAMES_PER_SECOND;
    positive(text).ok().filter(|value| *value <= most).ok_or(format!("expected a number above 0, at most {most}"))
}

/// Everything `--json` prints.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Evaluation {
    /// The picture's file.
    pub picture: PathBuf,
    /// The reference's file.
    pub reference: PathBuf,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// The factor before the display curve.
    pub exposure: f32,
    /// Whether the reference's own noise was taken out of relL2.
    pub reference_noise_removed: bool,
    /// The picture's figures.
    pub figures: Figures,
    /// The denoiser's, when it was given.
    pub denoised: Option<DenoisedEvaluation>,
}

/// The denoiser's picture beside the one measured.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DenoisedEvaluation {
    /// The denoiser's file.
    pub picture: PathBuf,
    /// Its figures.
    pub figures: Figures,
    /// relL2 of the picture over the denoiser's; `null` in JSON where the denoiser's is not above 0.
    pub rel_l2_ratio: f64,
    /// 1 - [`sspc_metrics::rel_l2_gain`] / the denoiser's relL2: the same ratio without what noise of the reference does to relL2;
    /// `null` in JSON where the reference has no halves.
    pub crossed_ratio: f64,
    /// Its standard error over pixels taken as independent.
    pub crossed_ratio_standard_error: f64,
}

/// Runs the subcommand.
///
/// # Errors
/// A [`Failure`] with its exit code.
pub fn run(arguments: &EvaluateArguments) -> Result<(), Failure> {
    if let Some(frames) = &arguments.frames {
        return evaluate_shot::run(arguments, &frames.parse()?);
    }
    let inputs = inputs(arguments);
    if let Some(path) = &arguments.error_map {
        check_output(path, &inputs)?;
    }
    let read = Read::of(arguments)?;
    let evaluation = evaluate(arguments, &read.picture, &read.reference, read.denoised.as_ref())?;
    interrupt::check()?;
    if let Some(path) = &arguments.error_map {
        preview::write_png(path, &inputs, &preview::error_map(&rel_l2_map(&read.picture, &read.reference.mean)))?;
    }
    let text = if arguments.json { json(&evaluation)? } else { table(&evaluation) };
    print_result(&text)
}

impl EvaluateArguments {
    /// The reference, placed like the picture where that is told.
    pub(crate) fn read_reference(&self, like: Option<Like>) -> Result<Reference, Failure> {
        Ok(match &self.layer {
            Some(layer) => read_reference_layer(&self.reference, layer, like)?,
            None => read_reference(&self.reference, like)?,
        })
    }
}

/// The pictures of one evaluation.
pub(crate) struct Read {
    pub picture: Image,
    pub reference: Reference,
    pub denoised: Option<Image>,
}

impl Read {
    /// Reads them, all of the picture's size.
    pub fn of(arguments: &EvaluateArguments) -> Result<Self, Failure> {
        let layer = arguments.layer.as_deref();
        let read = |path: &Path, like| match layer {
            Some(layer) => read_placed_layer(path, layer, like),
            None => read_placed_picture(path, like),
        };
        let (picture, placing) = read(&arguments.picture, None)?;
        let like = Some(Like { path: &arguments.picture, placing });
        let reference = arguments.read_reference(like)?;
        let denoised = arguments.denoised.as_deref().map(|path| read(path, like)).transpose()?.map(|(image, _)| image);
        Ok(Self { picture, reference, denoised })
    }

    /// What is compared with the frame before.
    pub fn measured(&self) -> Measured<'_> {
        Measured { picture: &self.picture, denoised: self.denoised.as_ref(), reference: &self.reference }
    }
}

fn inputs(arguments: &EvaluateArguments) -> Vec<PathBuf> {
    let required = [&arguments.picture, &arguments.reference];
    required.into_iter().chain(&arguments.denoised).cloned().collect()
}

pub(crate) fn evaluate(
    arguments: &EvaluateArguments,
    picture: &Image,
    reference: &Reference,
    denoised: Option<&Image>,
) -> Result<Evaluation, Failure> {
    let exposure = arguments.exposure.unwrap_or_else(|| auto_exposure(&reference.mean));
    let own = figures(picture, reference, exposure);
    if own.pixels == 0 {
        let message = format!(
            "{}: expected pixels that are finite in it and in {}, found none",
            arguments.picture.display(),
            arguments.reference.display()
        );
        return Err(Failure::new(Code::Input, message, "one of the two holds only NaN or infinity"));
    }
    interrupt::check()?;
    let denoised = denoised.zip(arguments.denoised.clone()).map(|(image, path)| {
        let beside = Comparison::of(picture, &own, image, reference, exposure);
        DenoisedEvaluation {
            picture: path,
            figures: beside.figures,
            rel_l2_ratio: beside.rel_l2_ratio,
            crossed_ratio: beside.crossed_ratio,
            crossed_ratio_standard_error: beside.crossed_ratio_standard_error,
        }
    });
    Ok(Evaluation {
        picture: arguments.picture.clone(),
        reference: arguments.reference.clone(),
        width: picture.width(),
        height: picture.height(),
        exposure,
        reference_noise_removed: reference.halves.is_some(),
        figures: own,
        denoised,
    })
}

pub(crate) fn json(evaluation: &impl Serialize) -> Result<String, Failure> {
    let text = serde_json::to_string_pretty(evaluation);
    text.map(|text| text + "\n").map_err(|error| Failure::new(Code::Run, format!("cannot write as JSON: {error}"), ""))
}

fn table(evaluation: &Evaluation) -> String {
    let noise = if evaluation.reference_noise_removed { "taken out" } else { "left in (it has no halves)" };
    let mut text = format!(
        "{} against {}: {}x{}, exposure {:.4}, reference noise {noise}\n{:<9} {:>11} {:>11} {:>10} {:>8} {:>8} {:>7} {:>7} {:>9}\n",
        evaluation.picture.display(),
        evaluation.reference.display(),
        evaluation.width,
        evaluation.height,
        evaluation.exposure,
        "",
        "relL2",
        "std. error",
        "brightness",
        "SMAPE",
        "PSNR dB",
        "SSIM",
        "FLIP",
        "excluded"
    );
    text += &row("picture", &evaluation.figures);
    if let Some(denoised) = &evaluation.denoised {
        text += &row("denoised", &denoised.figures);
        text += &format!("{:<9} {:>11.4}\n", "ratio", denoised.rel_l2_ratio);
        if denoised.crossed_ratio.is_finite() {
            let (ratio, error) = (denoised.crossed_ratio, denoised.crossed_ratio_standard_error);
            text += &format!("{:<9} {ratio:>11.4} {error:>11.4}   across the reference's halves\n", "");
        }
    }
    text
}

fn row(name: &str, figures: &Figures) -> String {
    format!(
        "{name:<9} {:>11.6} {:>11.6} {:>10.4} {:>8.4} {:>8.2} {:>7.4} {:>7.4} {:>9}\n",
        figures.rel_l2,
        figures.rel_l2_standard_error,
        figures.brightness,
        figures.smape,
        figures.psnr,
        figures.ssim,
        figures.flip,
        figures.excluded
    )
}
