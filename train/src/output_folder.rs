//! The folder a fit writes: made when needed; when something fails, files that were not there before
//! are removed again, and each file that was there is the old one or the whole new one.

use sspc_cli::{Code, Failure};
use sspc_frames::atomic::check_folder;
use std::path::{Path, PathBuf};

/// An output folder and the files of this run in it. Dropped before [`OutputFolder::keep`], it
/// removes what this run has added.
#[derive(Debug)]
pub struct OutputFolder {
    path: PathBuf,
    created: bool,
    added: Vec<PathBuf>,
    kept: bool,
}

impl OutputFolder {
    /// Opens or makes the folder.
    ///
    /// # Errors
    /// When it cannot be made, is not a folder, or cannot be written to.
    pub fn open(path: &Path) -> Result<Self, Failure> {
        let refuse = |source: std::io::Error| {
            let message = format!("{}: cannot make the output folder: {source}", path.display());
            Failure::new(Code::Run, message, "check that the parent folder exists and may be written to")
        };
        let created = path.symlink_metadata().is_err();
        if created {
            std::fs::create_dir(path).map_err(refuse)?;
        }
        let folder = Self { path: path.to_path_buf(), created, added: Vec::new(), kept: false };
        check_folder(path).map_err(refuse)?;
        Ok(folder)
    }

    /// The path of a file in the folder.
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// The path of a file that is about to be written.
    pub fn add(&mut self, name: &str) -> PathBuf {
        let path = self.file(name);
        if path.symlink_metadata().is_err() && !self.added.contains(&path) {
            self.added.push(path.clone());
        }
        path
    }

    /// Everything is written: nothing will be removed.
    pub fn keep(mut self) {
        self.kept = true;
    }
}

impl Drop for OutputFolder {
    fn drop(&mut self) {
        if !self.kept {
            // Best effort: what cannot be removed was reported by the failure that led here.
            for file in &self.added {
                let _ = std::fs::remove_file(file);
            }
            if self.created {
                let _ = std::fs::remove_dir(&self.path);
            }
        }
    }
}
