//! Why a file's structure is refused, before anybody has said what the file is for.

use exr::error::Error as ExrError;
use std::io;

/// What is wrong with a file.
#[derive(Debug)]
pub enum Fault {
    /// The system's word.
    Io(io::Error),
    /// Not as the format has it; with what was found.
    Damaged(String),
    /// As the format has it, but not for us.
    Unsupported { expected: &'static str, found: String },
    /// More than a file of this length can hold, or than is taken.
    TooLarge { expected: String, found: String },
}

impl Fault {
    pub fn damaged(found: impl Into<String>) -> Self {
        Fault::Damaged(found.into())
    }

    /// The file ends before it should.
    pub fn cut_short() -> Self {
        Fault::damaged("its end before all pixels")
    }
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        match error.kind() {
            io::ErrorKind::UnexpectedEof => Fault::cut_short(),
            _ => Fault::Io(error),
        }
    }
}

impl From<ExrError> for Fault {
    fn from(error: ExrError) -> Self {
        match error {
            ExrError::Io(error) => error.into(),
            ExrError::NotSupported(what) => {
                Fault::Unsupported { expected: "a known OpenEXR feature", found: what.to_string() }
            }
            other => Fault::Damaged(other.to_string()),
        }
    }
}
