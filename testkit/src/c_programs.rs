//! C, compiled for a test.

use crate::skips::skipped;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// What `cc` makes of these arguments; `None`, said aloud, where there is none.
pub fn cc(what: &str, arguments: impl IntoIterator<Item = impl AsRef<OsStr>>) -> Option<Output> {
    match Command::new("cc").args(arguments).output() {
        Ok(done) => Some(done),
        Err(error) => {
            skipped(what, &format!("cc: {error}"));
            None
        }
    }
}

/// A library in `folder` that passes for Open Image Denoise and has a fault (`stand_in.c` has them); `None`, said aloud,
/// without `cc`.
///
/// # Panics
/// When it cannot be compiled.
pub fn oidn_stand_in(folder: &Path, fault: &str) -> Option<PathBuf> {
    let library = folder.join("libOpenImageDenoise.so.2");
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("stand_in.c");
    let fault = format!("-DSTAND_IN={fault}");
    let flags = ["-std=c99", "-shared", "-fPIC", "-O1", "-Wall", "-Werror", &fault, "-o"].map(OsStr::new);
    let files = [library.as_os_str(), source.as_os_str()];
    let done = cc("a stand-in for Open Image Denoise", flags.into_iter().chain(files))?;
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    Some(library)
}
