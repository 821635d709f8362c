//! How a command runs: how much it prints, on how many threads, and how much of the correction it uses.

use crate::failure::{Code, Failure};
use crate::openjd;
use clap::{Args, ValueEnum};
use std::thread::available_parallelism;

/// What every command that corrects frames takes.
#[derive(Args, Clone, Debug)]
pub struct RunArgs {
    /// Share of the correction that is added to the denoiser's picture: 0 gives the denoiser's, 1 the whole correction
    #[arg(long, value_name = "0..1", default_value_t = 1.0, value_parser = share)]
    pub strength: f32,

    /// Threads, no more than there are cores [default: all cores]
    #[arg(long, value_name = "N", value_parser = at_least_one)]
    pub threads: Option<usize>,

    /// Say what would be read, used, skipped and written, and stop
    #[arg(long)]
    pub dry_run: bool,

    /// Print errors only
    #[arg(short, long, conflicts_with = "verbose")]
    pub quiet: bool,

    /// Print roles, times and memory of every frame
    #[arg(short, long)]
    pub verbose: bool,

    /// How progress is told
    #[arg(long, value_enum, default_value_t = ProgressFormat::Auto)]
    pub progress: ProgressFormat,
}

/// How progress is told.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub enum ProgressFormat {
    /// A bar on a terminal, lines elsewhere
    #[default]
    Auto,
    /// openjd_progress, openjd_status and openjd_fail on standard output, for render farms
    Openjd,
}

/// How much is printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verbosity {
    /// Errors only.
    Quiet,
    /// What a person should know.
    Normal,
    /// Roles, times and memory too.
    Verbose,
}

impl RunArgs {
    /// How much is printed.
    pub fn verbosity(&self) -> Verbosity {
        match (self.quiet, self.verbose) {
            (true, _) => Verbosity::Quiet,
            (false, true) => Verbosity::Verbose,
            (false, false) => Verbosity::Normal,
        }
    }

    /// Passes a command's outcome on; a failure is told to the farm too, where progress is.
    ///
    /// # Errors
    /// The failure, as it was.
    pub fn told(&self, outcome: Result<(), Failure>) -> Result<(), Failure> {
        if let (ProgressFormat::Openjd, Err(failure)) = (self.progress, &outcome) {
            openjd::fail(&failure.message);
        }
        outcome
    }

    /// Starts as many threads as were asked for, but no more than can run at once: they would take a fifth longer and
    /// change nothing. Once, before any work.
    ///
    /// # Errors
    /// When the system does not give them.
    pub fn start_threads(&self) -> Result<(), Failure> {
        let Some(threads) = self.threads else { return Ok(()) };
        let threads = available_parallelism().map_or(threads, |cores| threads.min(cores.get()));
        rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().map_err(|error| {
            Failure::new(Code::Run, format!("cannot start {threads} threads: {error}"), "ask for fewer")
        })
    }
}

/// A number from 0 to 1.
///
/// # Errors
/// Any other text.
pub fn share(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(share) if (0.0..=1.0).contains(&share) => Ok(share),
        _ => Err("expected a number from 0 to 1".to_string()),
    }
}

/// A whole number of at least 1.
///
/// # Errors
/// Any other text.
pub fn at_least_one(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(number) if number >= 1 => Ok(number),
        _ => Err("expected a whole number of at least 1".to_string()),
    }
}
