//! `sspc-infer`: measures and corrects pictures; see `sspc-infer --help`.
#![forbid(unsafe_code)]

use clap::Parser;
use sspc_cli::{failure, interrupt};
use sspc_infer::{cli, clock};
use std::process::ExitCode;

fn main() -> ExitCode {
    clock::start();
    let arguments = cli::Arguments::parse();
    interrupt::listen();
    failure::exit_code(cli::run(arguments))
}
