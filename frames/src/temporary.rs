//! Files under a temporary name, which vanish unless they get their own.
//!
//! Whoever writes such a file holds a lock on it (`flock`), which ends with the process however it ends. So a file of
//! this kind without a lock was left by a process that was killed, and the next one that writes to the folder
//! removes it. Where a file system knows no locks, leftovers stay.

use std::collections::BTreeSet;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard};

const PREFIX: &str = ".sspc-";
const SUFFIX: &str = ".tmp";

/// The temporary files of this process. Whoever makes, renames or removes one holds the lock.
static LIVE: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

fn live() -> MutexGuard<'static, BTreeSet<PathBuf>> {
    // A panic elsewhere leaves the set itself sound.
    LIVE.lock().unwrap_or_else(|broken| broken.into_inner())
}

/// Removes this process's temporary files, for a process that is about to end at once. Threads that would make or
/// rename one wait for that end.
pub fn abandon() {
    let live = live();
    for path in live.iter() {
        // Nobody is left to be told.
        let _ = std::fs::remove_file(path);
    }
    std::mem::forget(live);
}

/// A file that is removed unless it gets its final name.
pub(crate) struct Temporary {
    path: PathBuf,
    /// Holds the lock for as long as this value lives.
    lock: File,
    renamed: bool,
}

impl Temporary {
    /// Creates a new file `.sspc-PID-N.tmp` in `folder`; an existing file or link of that name is never opened.
    pub fn create_in(folder: &Path) -> io::Result<(Self, File)> {
        static COUNTER: AtomicU64 = AtomicU64::new(0);
        const TRIES: usize = 1_000;
        remove_leftovers(folder);
        let mut last = io::ErrorKind::AlreadyExists.into();
        for _ in 0..TRIES {
            let number = COUNTER.fetch_add(1, Ordering::Relaxed);
            let path = folder.join(format!("{PREFIX}{}-{number}{SUFFIX}", std::process::id()));
            match Self::create(path) {
                Ok((temporary, file)) if temporary.claim() => return Ok((temporary, file)),
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => last = error,
                Err(error) => return Err(error),
            }
        }
        Err(last)
    }

    fn create(path: PathBuf) -> io::Result<(Self, File)> {
        let mut live = live();
        let file = OpenOptions::new().write(true).create_new(true).open(&path)?;
        live.insert(path.clone());
        drop(live);
        match file.try_clone() {
            Ok(lock) => Ok((Self { path, lock, renamed: false }, file)),
            Err(error) => {
                discard(&path);
                Err(error)
            }
        }
    }

    /// Locks the file. Not so when another process has just taken it for a leftover.
    fn claim(&self) -> bool {
        match self.lock.try_lock() {
            Ok(()) | Err(TryLockError::Error(_)) => is_still(&self.path, &self.lock),
            Err(TryLockError::WouldBlock) => false,
        }
    }

    /// The temporary name.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Gives the file its name, in place of what had it before.
    pub fn rename_to(mut self, path: &Path) -> io::Result<()> {
        let renamed = {
            let mut live = live();
            std::fs::rename(&self.path, path).map(|()| live.remove(&self.path))
        };
        self.renamed = renamed.is_ok();
        renamed.map(|_| ())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        if !self.renamed {
            discard(&self.path);
        }
    }
}

fn discard(path: &Path) {
    let mut live = live();
    // Nothing more can be done about a file that will not go.
    let _ = std::fs::remove_file(path);
    live.remove(path);
}

/// Whether the path still leads to this file.
#[cfg(unix)]
fn is_still(path: &Path, file: &File) -> bool {
    use std::os::unix::fs::MetadataExt;
    let identity = |meta: std::fs::Metadata| (meta.dev(), meta.ino());
    let (at_path, opened) = (path.symlink_metadata().map(identity), file.metadata().map(identity));
    matches!((at_path, opened), (Ok(x), Ok(y)) if x == y)
}

#[cfg(not(unix))]
fn is_still(path: &Path, _: &File) -> bool {
    path.exists()
}

/// Removes what killed processes left in a folder; a process looks once into each folder.
fn remove_leftovers(folder: &Path) {
    static SEEN: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());
    if !SEEN.lock().unwrap_or_else(|broken| broken.into_inner()).insert(folder.to_path_buf()) {
        return;
    }
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    for path in entries.filter(|entry| is_ours(&entry.file_name().to_string_lossy())).map(|entry| entry.path()) {
        // What cannot be removed harms nobody but the disk.
        let _ = remove_leftover(&path);
    }
}

/// `.sspc-PID-N.tmp`.
fn is_ours(name: &str) -> bool {
    let number = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    let middle = name.strip_prefix(PREFIX).and_then(|rest| rest.strip_suffix(SUFFIX));
    middle.and_then(|rest| rest.split_once('-')).is_some_and(|(pid, n)| number(pid) && number(n))
}

fn remove_leftover(path: &Path) -> io::Result<()> {
    if !path.symlink_metadata()?.is_file() {
        return Ok(());
    }
    let file = File::open(path)?;
    if file.try_lock().is_ok() && is_still(path, &file) {
        std::fs::remove_file(path)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = std::fs::read_dir(folder).expect("folder");
        let mut names: Vec<String> =
            entries.map(|entry| entry.expect("entry").file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    #[test]
    fn only_names_of_this_form_are_ours() {
        assert!(is_ours(".sspc-12-0.tmp"));
        for other in [".sspc-.tmp", ".sspc-1.tmp", ".sspc-1-.tmp", ".sspc-1-2-3.tmp", ".sspc-a-1.tmp", "sspc-1-2.tmp"] {
            assert!(!is_ours(other), "{other}");
        }
    }

    #[test]
    fn leftovers_go_and_all_else_stays() {
        let folder = tempfile::tempdir().expect("folder");
        let path = |name: &str| folder.path().join(name);
        for name in [".sspc-1-0.tmp", ".sspc-99999999-7.tmp", "picture.exr", ".sspc-notes.tmp", ".sspc-2-0.tmp"] {
            std::fs::write(path(name), "x").expect("written");
        }
        std::fs::create_dir(path(".sspc-3-0.tmp")).expect("a folder of that name");
        #[cfg(unix)]
        std::os::unix::fs::symlink(path("picture.exr"), path(".sspc-4-0.tmp")).expect("a link of that name");
        // Somebody still writes this one.
        let writing = File::open(path(".sspc-2-0.tmp")).expect("opened");
        writing.lock().expect("locked");
        let (temporary, _file) = Temporary::create_in(folder.path()).expect("created");
        let mut kept = vec![".sspc-2-0.tmp", ".sspc-3-0.tmp", ".sspc-notes.tmp", "picture.exr"];
        if cfg!(unix) {
            kept.push(".sspc-4-0.tmp");
        }
        let own = temporary.path.file_name().expect("a name").to_string_lossy().into_owned();
        kept.push(&own);
        kept.sort_unstable();
        assert_eq!(names(folder.path()), kept);
        drop(temporary);
        assert!(!path(&own).exists());
    }

    /// Many writers in one folder, each of which takes the others' files for leftovers if it can.
    #[test]
    fn nobody_removes_what_another_is_writing() {
        let folder = tempfile::tempdir().expect("folder");
        std::thread::scope(|scope| {
            for thread in 0..4 {
                let folder = folder.path();
                scope.spawn(move || {
                    for round in 0..200 {
                        let (temporary, _file) = Temporary::create_in(folder).expect("created");
                        for name in names(folder).iter().filter(|name| is_ours(name)) {
                            let _ = remove_leftover(&folder.join(name));
                        }
                        temporary.rename_to(&folder.join(format!("{thread}-{round}"))).expect("still there");
                    }
                });
            }
        });
        assert_eq!(names(folder.path()).len(), 4 * 200);
    }
}
