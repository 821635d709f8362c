//! sspc-train: fits the corrector to a frame and exports it.

use clap::Parser;
use sspc_train::cli::{Cli, Command};
use sspc_train::progress::print_line;
use sspc_train::{fit_command, init, interrupt};
use std::process::ExitCode;

fn main() -> ExitCode {
    let cli = Cli::parse();
    interrupt::install();
    let outcome = match &cli.command {
        Command::Fit(args) => fit_command::run(args),
        Command::Export(args) => init::export(args),
    };
    match outcome {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            print_line(&format!("sspc-train: error: {error}"));
            if let Some(advice) = error.advice() {
                print_line(&format!("  {advice}"));
            }
            ExitCode::from(error.exit_code())
        }
    }
}
