//! Errors of reading and writing: one line each, naming file, role, what was expected and what was found.

use sspc_image::{Buffer, Role};
use std::path::PathBuf;
use std::{fmt, io};

/// What a file or a channel was needed for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Purpose {
    /// A role of one buffer of the frame.
    Role(Role, Buffer),
    /// The reference to compare with.
    Reference,
    /// Any picture, e.g. one to be measured.
    Picture,
}

impl fmt::Display for Purpose {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Purpose::Role(role, buffer) => write!(out, "{role} of {buffer}"),
            Purpose::Reference => out.write_str("reference"),
            Purpose::Picture => out.write_str("colour"),
        }
    }
}

/// Whose fault an error is; binaries map it to their exit code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ErrorKind {
    /// The command asks for something that has no meaning.
    Arguments,
    /// A file that was read is not what it should be.
    Input,
    /// The result could not be written.
    Output,
}

/// Everything that can go wrong between files and frames.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each message says what its fields are")]
pub enum Error {
    #[error("{}: no such file, expected the {purpose}", path.display())]
    MissingFile { path: PathBuf, purpose: Purpose },

    #[error("{}: cannot read the {purpose}: {source}", path.display())]
    Unreadable { path: PathBuf, purpose: Purpose, source: io::Error },

    #[error("{}: not an OpenEXR file: expected the {purpose}, found {found}", path.display())]
    NotExr { path: PathBuf, purpose: Purpose, found: String },

    #[error("{}: truncated or damaged, expected the {purpose} in {expected}, found {found}", path.display())]
    Damaged { path: PathBuf, purpose: Purpose, expected: String, found: String },

    #[error("{}: cannot take the {purpose} from it: expected {expected}, found {found}", path.display())]
    Unsupported { path: PathBuf, purpose: Purpose, expected: String, found: String },

    #[error("{}: the header claims too much for the {purpose}: expected {expected}, found {found}", path.display())]
    TooLarge { path: PathBuf, purpose: Purpose, expected: String, found: String },

    #[error("{}: no {purpose}: expected {expected}, found {found}", path.display())]
    MissingRole { path: PathBuf, purpose: Purpose, expected: String, found: String },

    #[error("{}: no view '{wanted}', found {found}", path.display())]
    MissingView { path: PathBuf, wanted: String, found: String },

    #[error("{}: size of the {purpose}: expected {expected} as in {}, found {found}", path.display(), like.display())]
    SizeMismatch { path: PathBuf, purpose: Purpose, expected: String, found: String, like: PathBuf },

    #[error("{}: {purpose}: expected samples independent of {}, found the same value in every pixel", b.display(), a.display())]
    IdenticalHalves { a: PathBuf, b: PathBuf, purpose: Purpose },

    #[error("{}: channel {channel} of the {purpose}: expected radiance, found only NaN or infinity", path.display())]
    NothingFinite { path: PathBuf, purpose: Purpose, channel: String },

    #[error("{}: additive passes: expected {expected}, found {found}", path.display())]
    Passes { path: PathBuf, expected: String, found: String },

    #[error("role override '{text}': expected {expected}, found {found}")]
    Override { text: String, expected: String, found: String },

    #[error("'{text}': expected {expected}, found {found}")]
    Pattern { text: String, expected: String, found: String },

    #[error("{}: expected {expected}, found {found}", path.display())]
    Output { path: PathBuf, expected: String, found: String },

    #[error("{}: cannot write: {source}", path.display())]
    Unwritable { path: PathBuf, source: io::Error },

    #[error("{}: what was written cannot be read back: {found}", path.display())]
    NotReadBack { path: PathBuf, found: String },
}

impl Error {
    /// Whose fault it is.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::Override { .. } | Error::Pattern { .. } => ErrorKind::Arguments,
            Error::Output { .. } | Error::Unwritable { .. } | Error::NotReadBack { .. } => ErrorKind::Output,
            _ => ErrorKind::Input,
        }
    }

    /// One line of advice for the person at the command line.
    pub fn advice(&self) -> &'static str {
        match self {
            Error::MissingFile { .. } => {
                "check the path; every half, denoised half and reference must exist before the run"
            }
            Error::Unreadable { .. } => "check the file's permissions and the disk it lies on",
            Error::NotExr { .. } => "give OpenEXR files; convert other formats first, keeping linear values",
            Error::Damaged { .. } => "render or copy the file again; it may still be being written",
            Error::Unsupported { .. } => {
                "write flat, unsampled half or float channels (no deep data, no chroma subsampling)"
            }
            Error::TooLarge { .. } => "the header does not fit the file; render or copy it again",
            Error::MissingRole { purpose: Purpose::Picture | Purpose::Reference, .. } => {
                "give a file that has the colour under one of these names"
            }
            Error::MissingRole { .. } => {
                "name the channels with --role, e.g. --role albedo=LAYER or --role denoised-a=FILE.exr"
            }
            Error::MissingView { .. } => "name a view of every file with --view, or all of them with --view all",
            Error::SizeMismatch { .. } => {
                "render all files of a frame with one resolution and one display window; crops are laid over each other"
            }
            Error::IdenticalHalves { .. } => "render the second half with another seed",
            Error::NothingFinite { .. } => "check the render; its colour holds no usable value",
            Error::Override { .. } => "write ROLE[-a|-b|-full]=LAYER, =CH,CH,CH, =FILE.exr, =FILE.exr:LAYER or =none",
            Error::Pattern { .. } => {
                "write shot.####.exr or shot.%04d.exr, and frames as 1001-1020, 1-100x5, 1-100:5 or 1001,1005-1010"
            }
            Error::Passes { .. } => {
                "name all passes that add up to the noisy colour, each once, e.g. --passes 'RGBA_*'"
            }
            Error::Output { .. } => "choose another output path",
            Error::NotReadBack { .. } => "check the disk; if it is sound, report the input file that leads to this",
            Error::Unwritable { .. } => "check that the folder exists, may be written to and has space left",
        }
    }
}
