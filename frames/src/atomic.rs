//! Outputs that appear whole or not at all.
//!
//! A file is written under a temporary name in the same folder (`.sspc-PID-N.tmp`), flushed to disk and renamed
//! into place: whoever looks at the path sees the old file or the new one, never a part. A temporary file is
//! removed on failure; what a process killed outright leaves is removed by the next that writes to the folder.

use crate::error::Error;
use crate::temporary::Temporary;
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// Writes `path` through `write`; `inputs` are files that must not be overwritten.
///
/// # Errors
/// [`Error::Output`] when `path` is an input, a folder or a symbolic link (which would be followed out of the
/// folder or silently replaced), [`Error::Unwritable`] when writing fails. Nothing is left behind then.
pub fn atomic_write(
    path: &Path,
    inputs: &[PathBuf],
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
) -> Result<(), Error> {
    atomic_write_checked(path, inputs, write, |_| Ok(()))
}

/// The same with a look at the file, under its temporary name, before it takes its own.
///
/// # Errors
/// As [`atomic_write`], and [`Error::NotReadBack`] with what `check` found.
pub fn atomic_write_checked(
    path: &Path,
    inputs: &[PathBuf],
    write: impl FnOnce(&mut BufWriter<File>) -> io::Result<()>,
    check: impl FnOnce(&Path) -> Result<(), String>,
) -> Result<(), Error> {
    check_output(path, inputs)?;
    let unwritable = |source| Error::Unwritable { path: path.to_path_buf(), source };
    let (temporary, file) = Temporary::create_in(folder_of(path)).map_err(unwritable)?;
    let mut writer = BufWriter::new(file);
    write(&mut writer).map_err(unwritable)?;
    let file = writer.into_inner().map_err(|error| unwritable(error.into_error()))?;
    // The disk takes its time, in which the file can be read.
    let (flushed, checked) = std::thread::scope(|scope| {
        let flushed = scope.spawn(move || file.sync_all());
        let checked = check(temporary.path());
        (flushed.join(), checked)
    });
    flushed.unwrap_or_else(|_| Err(io::Error::other("the file could not be flushed"))).map_err(unwritable)?;
    checked.map_err(|found| Error::NotReadBack { path: path.to_path_buf(), found })?;
    temporary.rename_to(path).map_err(unwritable)
}

/// Writes bytes as [`atomic_write`] does.
///
/// # Errors
/// As [`atomic_write`].
pub fn atomic_write_bytes(path: &Path, inputs: &[PathBuf], bytes: &[u8]) -> Result<(), Error> {
    atomic_write(path, inputs, |file| file.write_all(bytes))
}

/// Whether files can be written in `folder`: one is, and removed again.
///
/// # Errors
/// What the system says.
pub fn check_folder(folder: &Path) -> io::Result<()> {
    Temporary::create_in(folder).map(drop)
}

/// Whether `path` may be written: worth asking before minutes of work.
///
/// # Errors
/// [`Error::Output`] naming what stands in the way.
pub fn check_output(path: &Path, inputs: &[PathBuf]) -> Result<(), Error> {
    let refuse = |expected: &str, found: String| {
        Err(Error::Output { path: path.to_path_buf(), expected: expected.to_string(), found })
    };
    if path.file_name().is_none() {
        return refuse("a file name", "none".into());
    }
    if !folder_of(path).is_dir() {
        return refuse("an existing folder to write to", format!("no folder {}", folder_of(path).display()));
    }
    match std::fs::symlink_metadata(path) {
        Ok(meta) if meta.is_dir() => return refuse("a file to write", "a folder".into()),
        Ok(meta) if meta.file_type().is_symlink() => {
            let target = std::fs::read_link(path).unwrap_or_default();
            return refuse("a file to write", format!("a symbolic link to {}", target.display()));
        }
        Ok(meta) if !meta.is_file() => return refuse("a file to write", "something that is no regular file".into()),
        _ => {}
    }
    match inputs.iter().find(|input| same_file(input, path)) {
        Some(input) => refuse("an output that is no input", format!("the input {}", input.display())),
        None => Ok(()),
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Same file by whatever name: equal canonical paths, or (on Unix) one inode.
fn same_file(a: &Path, b: &Path) -> bool {
    match (a.canonicalize(), b.canonicalize()) {
        (Ok(x), Ok(y)) if x == y => true,
        _ => same_inode(a, b),
    }
}

#[cfg(unix)]
fn same_inode(a: &Path, b: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |path: &Path| std::fs::metadata(path).map(|meta| (meta.dev(), meta.ino())).ok();
    matches!((identity(a), identity(b)), (Some(x), Some(y)) if x == y)
}

#[cfg(not(unix))]
fn same_inode(_: &Path, _: &Path) -> bool {
    false
}
