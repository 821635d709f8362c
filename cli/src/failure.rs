//! How a command ends: one line of what went wrong, one of advice, and an exit code.

use crate::print::print_line;
use sspc_frames::error::{Error, ErrorKind};
use sspc_kernels::simd::UnknownIsa;
use std::process::ExitCode;

/// Exit codes, printed by `--help`.
pub const EXIT_CODES: &str = "\
Exit codes:
  0    done
  2    the arguments make no sense
  3    an input is missing, damaged or not what it should be
  4    the run failed: an output could not be written, memory ran out, ...
  130  interrupted";

/// The exit codes of every subcommand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Code {
    /// The arguments make no sense (clap uses the same code).
    Arguments = 2,
    /// An input is missing, damaged or not what it should be.
    Input = 3,
    /// The run failed.
    Run = 4,
    /// Ctrl-C or a request to end.
    Interrupted = 130,
}

/// Why a command did not do what was asked.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Failure {
    /// The exit code.
    pub code: Code,
    /// One line.
    pub message: String,
    /// One line; empty for none.
    pub advice: String,
}

impl Failure {
    /// A failure in words.
    pub fn new(code: Code, message: impl Into<String>, advice: impl Into<String>) -> Self {
        Self { code, message: message.into(), advice: advice.into() }
    }

    /// The run was asked to stop.
    pub fn interrupted() -> Self {
        Self::new(Code::Interrupted, "interrupted", "outputs finished so far are complete; nothing partial was left")
    }

    /// Standard output is closed or full.
    pub fn from_stdout(error: &std::io::Error) -> Self {
        Self::new(Code::Run, format!("standard output: cannot write: {error}"), "keep the reading end of the pipe open")
    }
}

impl From<Error> for Failure {
    fn from(error: Error) -> Self {
        let code = match error.kind() {
            ErrorKind::Arguments => Code::Arguments,
            ErrorKind::Input => Code::Input,
            ErrorKind::Output => Code::Run,
        };
        Self::new(code, error.to_string(), error.advice())
    }
}

impl From<UnknownIsa> for Failure {
    fn from(error: UnknownIsa) -> Self {
        Self::new(Code::Arguments, error.to_string(), "unset it to take the widest that the machine has")
    }
}

/// Reports a failure on standard error and gives the process its exit code.
pub fn exit_code(outcome: Result<(), Failure>) -> ExitCode {
    let Err(failure) = outcome else { return ExitCode::SUCCESS };
    print_line(&format!("error: {}", failure.message));
    if !failure.advice.is_empty() {
        print_line(&format!("advice: {}", failure.advice));
    }
    ExitCode::from(failure.code as u8)
}
