//! The command line.

use crate::backend::Backend;
use crate::preset::Preset;
use clap::{Args, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;

/// Self-supervised post-correction for Monte Carlo renders: fits a small network to a frame's own
/// two half buffers and writes a picture better than the denoiser's.
#[derive(Debug, Parser)]
#[command(name = "sspc-train", version)]
pub struct Cli {
    #[command(subcommand)]
    pub command: Command,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fit the corrector to a frame (or several of a shot) and write the corrected picture.
    Fit(FitArgs),
    /// Write a fitted model as an ONNX graph.
    Export(ExportArgs),
}

#[derive(Args, Debug)]
#[command(group = clap::ArgGroup::new("frame").required(true).args(["a_file", "paper_layout", "a"]))]
pub struct FitArgs {
    /// Half buffer a, or one file whose layers hold both halves.
    #[arg(value_name = "A.exr")]
    pub a_file: Option<PathBuf>,
    /// Half buffer b.
    #[arg(value_name = "B.exr", requires = "a_file")]
    pub b_file: Option<PathBuf>,
    /// A shot instead of one frame: half buffers a, e.g. 'shot/a.####.exr'.
    #[arg(long, value_name = "PATTERN", requires_all = ["b", "frames"], conflicts_with = "a_file")]
    pub a: Option<String>,
    /// Half buffers b of the shot.
    #[arg(long, value_name = "PATTERN", requires = "a")]
    pub b: Option<String>,
    /// Frames of the shot to fit one model on, e.g. 1001,1004 or 1001-1020x5.
    #[arg(long, value_name = "RANGE", requires = "a")]
    pub frames: Option<String>,
    /// The denoiser's output on half a, when it is not in A.exr (a pattern for a shot).
    #[arg(long, value_name = "EXR")]
    pub denoised_a: Option<PathBuf>,
    /// The denoiser's output on half b, when it is not in B.exr (a pattern for a shot).
    #[arg(long, value_name = "EXR")]
    pub denoised_b: Option<PathBuf>,
    /// The denoiser's output on the full buffer: what the correction is added to.
    #[arg(long, value_name = "EXR")]
    pub denoised: Option<PathBuf>,
    /// A reference to measure against; its layers a and b, where present, take its own noise out.
    #[arg(long, value_name = "EXR")]
    pub reference: Option<PathBuf>,
    /// Root of a folder laid out as the paper's published data.
    #[arg(long, value_name = "ROOT", requires_all = ["scene", "spp", "denoiser"], conflicts_with_all = ["a_file", "a"])]
    pub paper_layout: Option<PathBuf>,
    /// Scene in the paper's layout.
    #[arg(long, requires = "paper_layout")]
    pub scene: Option<String>,
    /// Samples per pixel in the paper's layout.
    #[arg(long, requires = "paper_layout")]
    pub spp: Option<u32>,
    /// Denoiser in the paper's layout.
    #[arg(long, requires = "paper_layout")]
    pub denoiser: Option<String>,
    /// Which channels fill a role, e.g. --role albedo=LAYER, --role normal-a=FILE.exr:N, --role visibility=none.
    #[arg(long = "role", value_name = "ROLE=SOURCE")]
    pub roles: Vec<String>,
    /// How to train.
    #[arg(long, value_enum, default_value_t = Preset::Balanced)]
    pub preset: Preset,
    /// Seed of weights and tiles: the same seed gives the same picture on the same machine.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Change one setting of the preset, for experiments, e.g. --set window=15: window, hidden, layers,
    /// combination, gate, influence, sampling, tile, batch, rate, skip or composition. A wrong value is told
    /// what is allowed. Repeatable.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub changes: Vec<String>,
    /// Training steps instead of the preset's.
    #[arg(long, value_name = "N")]
    pub steps: Option<usize>,
    /// End training after this many seconds.
    #[arg(long, value_name = "SECONDS", value_parser = positive_seconds)]
    pub time_limit: Option<f64>,
    /// Share of the correction that is added to the denoiser's picture: 0 gives the denoiser's, 1 the whole correction.
    #[arg(long, value_name = "0..1", default_value_t = 1.0, value_parser = share)]
    pub strength: f32,
    /// Burn backend.
    #[arg(long, value_enum, default_value_t = Backend::Flex)]
    pub backend: Backend,
    /// Start from a fitted model instead of the preset's start. OUTDIR/model.onnx is refined in place.
    #[arg(long, value_name = "model.onnx")]
    pub init: Option<PathBuf>,
    /// Folder for corrected.exr, model.onnx, report.json and previews; made when absent.
    #[arg(short, long, value_name = "OUTDIR")]
    pub output: PathBuf,
    /// Say what would be read, used and skipped, and stop.
    #[arg(long)]
    pub dry_run: bool,
    /// Print errors only.
    #[arg(short, long)]
    pub quiet: bool,
}

/// Which graph to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Graph {
    /// Features to parameters.
    Network,
    /// The whole corrector, g_c included, in standard operators.
    Image,
}

#[derive(Args, Debug)]
pub struct ExportArgs {
    /// Folder of a fit, or a model.onnx.
    #[arg(value_name = "MODEL_DIR")]
    pub model: PathBuf,
    /// The ONNX file to write.
    #[arg(short, long, value_name = "X.onnx")]
    pub output: PathBuf,
    #[arg(long, value_enum, default_value_t = Graph::Network)]
    pub graph: Graph,
}

fn share(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err(format!("'{text}' is not a number from 0 to 1")),
    }
}

fn positive_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds > 0.0 && std::time::Duration::try_from_secs_f64(seconds).is_ok() => Ok(seconds),
        _ => Err(format!("'{text}' is not a positive number of seconds")),
    }
}
