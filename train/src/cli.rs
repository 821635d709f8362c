//! The command line.

use crate::backend::Backend;
use crate::preset::Preset;
use clap::{Args, Parser, Subcommand, ValueEnum};
use sspc_cli::failure::EXIT_CODES;
use sspc_cli::{FrameArgs, RunArgs};
use std::path::PathBuf;

/// Self-supervised post-correction for Monte Carlo renders: fits a small network to a frame's own
/// two half buffers and writes a picture better than the denoiser's.
#[derive(Debug, Parser)]
#[command(name = "sspc-train", version, after_help = EXIT_CODES)]
pub struct Cli {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What can be asked.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fit the corrector to a frame (or several of a shot) and write the corrected picture.
    Fit(Box<FitArgs>),
    /// Write a fitted model as an ONNX graph.
    Export(ExportArgs),
}

/// The arguments of `fit`.
#[derive(Args, Debug)]
pub struct FitArgs {
    /// The frame, or frames of a shot to fit one model on.
    #[command(flatten)]
    pub frame: FrameArgs,
    /// How to run.
    #[command(flatten)]
    pub run: RunArgs,
    /// A reference to measure against; its layers a and b, where present, take its own noise out (a pattern for a shot)
    #[arg(long, value_name = "EXR")]
    pub reference: Option<PathBuf>,
    /// How to train.
    #[arg(long, value_enum, default_value_t = Preset::Balanced)]
    pub preset: Preset,
    /// Seed of weights and tiles: the same seed gives the same picture on the same machine.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Change one setting of the preset, for experiments, e.g. --set window=15: window, early-window, hidden, layers,
    /// combination, gate, influence, sampling, tile, batch, rate, skip, composition, held-out or differences. An invalid value
    /// lists the allowed ones. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub changes: Vec<String>,
    /// Training steps instead of the preset's.
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// End training after this many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = positive_seconds)]
    pub time_limit: Option<f64>,
    /// Burn backend.
    #[arg(long, value_enum, default_value_t = Backend::Flex)]
    pub backend: Backend,
    /// Start from a fitted model instead of the preset's start. OUTDIR/model.onnx is refined in place.
    #[arg(long, value_name = "model.onnx")]
    pub init: Option<PathBuf>,
    /// Also write OUTDIR/report.html: pictures to flip and slide, error maps, curves and every figure, in one file.
    #[arg(long)]
    pub report: bool,
    /// Folder for corrected.exr, model.onnx, report.json and previews; made when absent.
    #[arg(short, long, value_name = "OUTDIR")]
    pub output: PathBuf,
}

/// Which graph to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Graph {
    /// Features to parameters.
    Network,
    /// The mean of both corrected halves, g_c included, in standard operators.
    Image,
    /// The finished picture, as `sspc-infer run` writes it, in standard operators.
    Picture,
    /// The same with g_c by an operator of our own, for onnxruntime with libsspc_operators.
    Operators,
}

/// The arguments of `export`.
#[derive(Args, Debug)]
pub struct ExportArgs {
    /// Folder of a fit, or a model.onnx.
    #[arg(value_name = "MODEL_DIR")]
    pub model: PathBuf,
    /// The ONNX file to write.
    #[arg(short, long, value_name = "X.onnx")]
    pub output: PathBuf,
    /// Which graph
    #[arg(long, value_enum, default_value_t = Graph::Network)]
    pub graph: Graph,
}

fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && std::time::Duration::try_from_secs_f64(seconds).is_ok() => Ok(seconds),
        _ => Err(format!("'{text}' is not a positive number of seconds")),
    }
}
