//! The page of a run: every frame that was corrected, and why the others were not.

use super::arguments::Job;
use super::beside::Beside;
use super::report::FrameReport;
use crate::flicker::Flicker;
use sspc_cli::output::Output;
use sspc_cli::{Code, Failure};
use sspc_core::correct::Corrected;
use sspc_frames::atomic::atomic_write_bytes;
use sspc_image::Image;
use sspc_page::{FailedFrame, Page, PageFrame};
use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};

/// Frames of a page to be.
pub struct PageOfRun {
    path: PathBuf,
    jobs: usize,
    frames: Vec<PageFrame>,
    failed: Vec<FailedFrame>,
    /// The last frame of each view, where it can be compared with the next: 48 bytes per pixel, 72 with the reference's
    /// halves.
    before: HashMap<Option<String>, Before>,
}

/// A frame that the next one is compared with.
struct Before {
    number: i32,
    picture: Image,
    beside: Beside,
}

impl PageOfRun {
    /// Of no frame yet.
    pub fn new(jobs: &[Job]) -> Self {
        Self { path: path(jobs), jobs: jobs.len(), frames: Vec::new(), failed: Vec::new(), before: HashMap::new() }
    }

    /// Where the page will be.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a frame, or one of `views` views of it.
    ///
    /// # Errors
    /// When a picture or the report cannot be encoded.
    pub fn add(
        &mut self,
        job: &Job,
        view: Option<&str>,
        views: usize,
        report: &FrameReport,
        beside: Beside,
        corrected: &Corrected,
    ) -> Result<(), Failure> {
        let name = match view {
            Some(view) => format!("{}, view {view}", job.frame.name()),
            None => job.frame.name(),
        };
        let pictures = beside.pictures(&corrected.picture, corrected.maps.as_ref().map(|maps| &maps.share));
        let mut report = serde_json::to_value(report).map_err(|error| refused(&self.path, error))?;
        let flicker = self.flicker(job.frame.number, view, &beside, &corrected.picture);
        if let Some(flicker) = flicker {
            report["temporal"] = serde_json::to_value(flicker).map_err(|error| refused(&self.path, error))?;
        }
        let frame = PageFrame::new(name, &pictures, report, self.jobs * views);
        self.frames.push(frame.map_err(|error| refused(&self.path, error))?);
        if let Some(number) = job.frame.number.filter(|_| self.jobs > 1 && beside.has_reference()) {
            let before = Before { number, picture: corrected.picture.clone(), beside };
            self.before.insert(view.map(String::from), before);
        }
        Ok(())
    }

    /// The change from the frame before, where that was corrected just now.
    fn flicker(&self, number: Option<i32>, view: Option<&str>, beside: &Beside, picture: &Image) -> Option<Flicker> {
        let before = self.before.get(&view.map(String::from))?;
        let follows = before.number.checked_add(1) == number && before.picture.same_size(picture);
        let (now, before) = (beside.measured(picture)?, before.beside.measured(&before.picture)?);
        follows.then(|| Flicker::of(now, before))
    }

    /// Notes a frame that was not corrected.
    pub fn add_failed(&mut self, job: &Job, failure: &Failure) {
        self.failed.push(FailedFrame { name: job.frame.name(), message: failure.message.clone() });
    }

    /// Writes the page; nothing where no frame was corrected. `protected` are files that must not be overwritten.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(self, jobs: &[Job], protected: &[PathBuf], output: &Output) -> Result<(), Failure> {
        let Some(first) = jobs.first().filter(|_| !self.frames.is_empty()) else { return Ok(()) };
        let page = Page {
            title: match jobs {
                [one] => one.frame.name(),
                several => format!("{} frames, from {}", several.len(), first.frame.files.a.display()),
            },
            tool: concat!("sspc-infer ", env!("CARGO_PKG_VERSION"), " run").into(),
            losses: Vec::new(),
            rates: Vec::new(),
            frames: self.frames,
            failed: self.failed,
        };
        atomic_write_bytes(&self.path, protected, page.html().as_bytes())?;
        output.say(&format!("page: {}", self.path.display()));
        Ok(())
    }
}

fn refused(path: &Path, error: impl Display) -> Failure {
    Failure::new(Code::Run, format!("{}: cannot write the page: {error}", path.display()), "leave --report out")
}

/// Beside the picture; of a shot beside its first, with the numbers of its first and last frame in the name.
fn path(jobs: &[Job]) -> PathBuf {
    match jobs {
        [] => PathBuf::new(),
        [one] => one.output.with_extension("html"),
        [first, .., last] => {
            let mut name = first.output.file_stem().unwrap_or_default().to_os_string();
            name.push(format!("-{}.html", last.frame.number.unwrap_or_default()));
            first.output.with_file_name(name)
        }
    }
}
