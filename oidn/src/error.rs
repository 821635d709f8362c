//! What can go wrong between a library and a denoised picture: one line each.

use std::path::PathBuf;

/// How to get the library on each platform, in two lines.
pub const HOW_TO_GET_IT: &str = "\
Linux, macOS, Windows: pip install pyoidn, or unpack a release of github.com/RenderKit/oidn; macOS also: brew install open-image-denoise
        Blender's and the system's are found by themselves, others by --oidn FOLDER or OIDN_DIR; or give --denoised-a and --denoised-b";

/// Why there is no denoised picture.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "each message says what its fields are")]
pub enum OidnError {
    #[error("no Open Image Denoise {MINIMUM} or later was found{}", listed(tried))]
    NotFound { tried: Vec<String> },

    #[error("{named}: expected the library of Open Image Denoise or its folder in {}, found none", path.display())]
    NotThere { named: &'static str, path: PathBuf },

    #[error("{}: cannot be opened as a library: {found}", path.display())]
    NotLoaded { path: PathBuf, found: String },

    #[error("{}: expected a library for {expected}, found one for {found}", path.display())]
    Architecture { path: PathBuf, expected: &'static str, found: String },

    #[error("{}: expected Open Image Denoise, found a library without {function}", path.display())]
    NotOidn { path: PathBuf, function: String },

    #[error("{}: expected Open Image Denoise {MINIMUM} or later, found {found}", path.display())]
    TooOld { path: PathBuf, found: String },

    #[error("{}: cannot start: {found}", path.display())]
    Device { path: PathBuf, found: String },

    #[error("Open Image Denoise {version} failed on {width}x{height} pixels ({what}): {found}")]
    Failed { version: String, what: String, width: usize, height: usize, found: String },

    #[error(
        "Open Image Denoise {version} returned {count} values of {width}x{height} pixels that are not finite ({what})"
    )]
    NotFinite { version: String, what: String, width: usize, height: usize, count: usize },

    #[error("interrupted while denoising")]
    Cancelled,
}

/// The oldest version that is used: the first with today's interface.
const MINIMUM: &str = "2.0";

fn listed(tried: &[String]) -> String {
    if tried.is_empty() { String::new() } else { format!(" (passed over: {})", tried.join("; ")) }
}

impl OidnError {
    /// Advice for the person at the command line.
    pub fn advice(&self) -> &'static str {
        match self {
            OidnError::NotFound { .. } | OidnError::TooOld { .. } => HOW_TO_GET_IT,
            OidnError::NotThere { .. } | OidnError::NotOidn { .. } => {
                "name the library's file (libOpenImageDenoise.so, .dylib, OpenImageDenoise.dll), its folder, or the folder above"
            }
            OidnError::NotLoaded { .. } => "keep the library beside the files that it came with; it needs them",
            OidnError::Architecture { .. } => "take the library's build for this processor and system",
            OidnError::Device { .. } => "it needs a processor with SSE4.1 or NEON; another version may say more",
            OidnError::Failed { .. } => {
                "free some memory, try --oidn-quality fast, or give the denoised pictures as files"
            }
            OidnError::NotFinite { .. } => "try another version of the library, or give the denoised pictures as files",
            OidnError::Cancelled => "",
        }
    }
}
