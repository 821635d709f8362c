//! What can end a run early, and the exit code it gives.

use sspc_frames::error::ErrorKind;
use std::path::PathBuf;

#[derive(Debug, thiserror::Error)]
pub enum Error {
    #[error(transparent)]
    Core(#[from] sspc_frames::error::Error),

    #[error("{}: {source}", path.display())]
    Model { path: PathBuf, source: sspc_onnx::FileError },

    #[error(transparent)]
    Invalid(#[from] sspc_onnx::Error),

    #[error("{}: cannot make the output folder: {source}", path.display())]
    Folder { path: PathBuf, source: std::io::Error },

    #[error("cannot write the report: {0}")]
    Report(serde_json::Error),

    #[error(transparent)]
    Setting(#[from] crate::experiment::Error),

    #[error("{0}")]
    Arguments(String),

    #[error("interrupted: nothing was written")]
    Interrupted,
}

impl Error {
    /// 2 bad arguments, 3 bad input, 4 a failed run, 130 interrupted.
    pub fn exit_code(&self) -> u8 {
        match self {
            Error::Arguments(_) | Error::Setting(_) => 2,
            Error::Core(error) => match error.kind() {
                ErrorKind::Arguments => 2,
                ErrorKind::Input => 3,
                ErrorKind::Output => 4,
            },
            Error::Model { .. } => 3,
            Error::Invalid(_) | Error::Report(_) | Error::Folder { .. } => 4,
            Error::Interrupted => 130,
        }
    }

    /// One line of advice, where there is any.
    pub fn advice(&self) -> Option<&'static str> {
        match self {
            Error::Core(error) => Some(error.advice()),
            Error::Model { .. } => Some("give a model.onnx that sspc-train fit wrote"),
            Error::Folder { .. } => Some("check that the parent folder exists and may be written to"),
            _ => None,
        }
    }
}
