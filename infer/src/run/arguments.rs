//! What `run` is told.

use crate::engine::Kernels;
use clap::{Args, ValueEnum};
use sspc_cli::frame_args::pattern;
use sspc_cli::run_args::at_least_one;
use sspc_cli::{Failure, FrameArgs, FrameJob, RunArgs};
use sspc_core::tiles::DEFAULT_TILE;
use sspc_kernels::simd::Isa;
use std::path::PathBuf;

/// The arguments of `run`.
#[derive(Clone, Debug, Args)]
pub struct RunArguments {
    /// The fitted model (any of its graphs)
    #[arg(long, value_name = "model.onnx")]
    pub model: PathBuf,

    /// The frames.
    #[command(flatten)]
    pub frame: FrameArgs,

    /// How to run.
    #[command(flatten)]
    pub run: RunArgs,

    /// The corrected picture (a pattern for a shot): a copy of A.exr with its colour replaced
    #[arg(short, long, value_name = "EXR")]
    pub output: PathBuf,

    /// Leave frames alone whose output exists
    #[arg(long)]
    pub skip_existing: bool,

    /// Write every figure beside each picture, as OUTPUT with the ending .json
    #[arg(long)]
    pub json: bool,

    /// Also write one page to look at beside the picture, as OUTPUT with the ending .html; of a shot one page of all frames
    #[arg(long)]
    pub report: bool,

    /// A reference to measure against, for --report and --json (a pattern for a shot)
    #[arg(long, value_name = "EXR")]
    pub reference: Option<PathBuf>,

    /// Side of the tiles that go through network and g_c at a time, in pixels; changes speed and memory, never the picture
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
    /// The kernels of this name.
    pub fn of(self, isa: Isa) -> Kernels {
        match self {
            KernelChoice::Fused => Kernels::Fused(isa),
            KernelChoice::Tract => Kernels::Tract,
        }
    }
}

/// One frame to correct, and where its picture goes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Job {
    /// The frame.
    pub frame: FrameJob,
    /// The picture.
    pub output: PathBuf,
}

impl Job {
    /// The file of the figures, of one view where all are corrected.
    pub fn sidecar(&self, view: Option<&str>) -> PathBuf {
        match view {
            Some(view) => {
                let plain: String = view.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
                self.output.with_extension(format!("{plain}.json"))
            }
            None => self.output.with_extension("json"),
        }
    }
}

impl RunArguments {
    /// The frames that the arguments name, in their order.
    ///
    /// # Errors
    /// Arguments that make no sense together, patterns without a place for the frame number.
    pub fn jobs(&self) -> Result<Vec<Job>, Failure> {
        let frames = self.frame.jobs(self.reference.as_deref())?;
        let output = |number: Option<i32>| match number {
            Some(number) => pattern(&self.output).map(|pattern| pattern.path(number)),
            None => Ok(self.output.clone()),
        };
        frames.into_iter().map(|frame| Ok(Job { output: output(frame.number)?, frame })).collect()
    }
}
