//! `sspc-train`: fits the corrector to a frame and exports it; see `sspc-train --help`.
#![forbid(unsafe_code)]

use clap::Parser;
use sspc_cli::{failure, interrupt};
use sspc_train::cli::{Cli, Command};
use sspc_train::{export, fit_command};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    interrupt::listen();
    failure::exit_code(match &cli.command {
        Command::Fit(args) => args.run.told(fit_command::run(args)),
        Command::Export(args) => export::run(args),
    })
}
