//! The command line: what can be asked, and who answers.

use crate::evaluate::{self, EvaluateArguments};
use crate::info::{self, InfoArguments};
use crate::run::{self, arguments::RunArguments};
use clap::{Parser, Subcommand};
use sspc_cli::Failure;
use sspc_cli::failure::EXIT_CODES;

/// Corrects Monte Carlo renders with a fitted model, and measures pictures against references.
#[derive(Debug, Parser)]
#[command(name = "sspc-infer", version, after_help = EXIT_CODES)]
pub struct Arguments {
    /// What to do.
    #[command(subcommand)]
    pub command: Command,
}

/// What to do.
#[derive(Debug, Subcommand)]
pub enum Command {
    /// Correct a frame, or the frames of a shot, with a fitted model
    Run(Box<RunArguments>),
    /// Say what a model file is: its contract, its origin, its size
    Info(InfoArguments),
    /// Measure a picture, or those of a shot, against references: relL2, SMAPE, PSNR, SSIM, FLIP, temporal error, JOD
    Evaluate(Box<EvaluateArguments>),
}

/// Does what was asked.
///
/// # Errors
/// A [`Failure`] that carries its exit code.
pub fn run(arguments: Arguments) -> Result<(), Failure> {
    match arguments.command {
        Command::Run(arguments) => arguments.run.told(run::run(&arguments)),
        Command::Info(arguments) => info::run(&arguments),
        Command::Evaluate(arguments) => evaluate::run(&arguments),
    }
}
