//! What `run` is told.

use crate::engine::{DEFAULT_TILE, Kernels};
use clap::{Args, ValueEnum};
use sspc_kernels::simd::Isa;
use std::path::PathBuf;

#[derive(Clone, Debug, Args)]
#[command(group = clap::ArgGroup::new("frame").required(true).args(["a_file", "a", "paper_layout"]))]
pub struct RunArguments {
    /// The fitted model (network or image graph)
    #[arg(long, value_name = "model.onnx")]
    pub model: PathBuf,

    /// Half buffer a, or one file whose layers hold both halves
    #[arg(value_name = "A.exr")]
    pub a_file: Option<PathBuf>,

    /// Half buffer b
    #[arg(value_name = "B.exr", requires = "a_file")]
    pub b_file: Option<PathBuf>,

    /// A shot: half buffers a, e.g. 'shot/a.####.exr', or files that hold both halves
    #[arg(long, value_name = "PATTERN", requires = "frames")]
    pub a: Option<String>,

    /// Half buffers b of the shot
    #[arg(long, value_name = "PATTERN", requires = "a")]
    pub b: Option<String>,

    /// Frames of the shot, e.g. 1001-1040, 1-100x5 or 1001,1005-1010
    #[arg(long, value_name = "RANGE", requires = "a")]
    pub frames: Option<String>,

    /// Root of a folder laid out as the paper's published data
    #[arg(long, value_name = "ROOT", requires_all = ["scene", "spp", "denoiser"])]
    pub paper_layout: Option<PathBuf>,

    /// Scene in the paper's layout
    #[arg(long, requires = "paper_layout")]
    pub scene: Option<String>,

    /// Samples per pixel in the paper's layout
    #[arg(long, requires = "paper_layout")]
    pub spp: Option<u32>,

    /// Denoiser in the paper's layout
    #[arg(long, requires = "paper_layout")]
    pub denoiser: Option<String>,

    /// The denoiser's output on half a, when it is not in A.exr (a pattern for a shot)
    #[arg(long, value_name = "EXR")]
    pub denoised_a: Option<PathBuf>,

    /// The denoiser's output on half b, when it is not in B.exr (a pattern for a shot)
    #[arg(long, value_name = "EXR")]
    pub denoised_b: Option<PathBuf>,

    /// The denoiser's output on the full buffer: what the correction is added to (a pattern for a shot)
    #[arg(long, value_name = "EXR")]
    pub denoised: Option<PathBuf>,

    /// Which channels fill a role, e.g. albedo=LAYER, normal-a=FILE.exr:N, visibility=none
    #[arg(long = "role", value_name = "ROLE=SOURCE")]
    pub roles: Vec<String>,

    /// The corrected picture (a pattern for a shot): a copy of A.exr with its colour replaced
    #[arg(short, long, value_name = "EXR")]
    pub output: PathBuf,

    /// Leave frames alone whose output exists
    #[arg(long)]
    pub skip_existing: bool,

    /// Say what would be read, used and written, and stop
    #[arg(long)]
    pub dry_run: bool,

    /// Write every figure beside each picture, as OUTPUT with the ending .json
    #[arg(long)]
    pub json: bool,

    /// Print errors only
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,

    /// Print roles, times and memory of every frame
    #[arg(short, long)]
    pub verbose: bool,

    /// Share of the correction that is added to the denoiser's picture: 0 gives the denoiser's, 1 the whole correction
    #[arg(long, value_name = "0..1", default_value_t = 1.0, value_parser = share)]
    pub strength: f32,

    /// Threads [default: all cores]
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    pub threads: Option<usize>,

    /// Side of the network's tiles in pixels; changes speed and memory, never the picture
    #[arg(long, value_name = "PIXELS", default_value_t = DEFAULT_TILE, value_parser = at_least_one)]
    pub tile: usize,

    /// Whose arithmetic runs the network
    #[arg(long, value_enum, default_value_t = KernelChoice::Fused)]
    pub kernels: KernelChoice,
}

/// Names of [`Kernels`] on the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum KernelChoice {
    /// This program's SIMD kernels as an operator of tract
    Fused,
    /// tract's own operators: slower, to check against
    Tract,
}

impl KernelChoice {
    pub fn of(self, isa: Isa) -> Kernels {
        match self {
            KernelChoice::Fused => Kernels::Fused(isa),
            KernelChoice::Tract => Kernels::Tract,
        }
    }
}

/// How much is printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verbosity {
    Quiet,
    Normal,
    Verbose,
}

impl RunArguments {
    pub fn verbosity(&self) -> Verbosity {
        match (self.quiet, self.verbose) {
            (true, _) => Verbosity::Quiet,
            (false, true) => Verbosity::Verbose,
            (false, false) => Verbosity::Normal,
        }
    }
}

fn share(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("expected a number from 0 to 1".to_string()),
    }
}

fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(number) if number >= 1 => Ok(number),
        _ => Err("expected a whole number of at least 1".to_string()),
    }
}
