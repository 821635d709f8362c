//! What the person sees: a bar over the frames on a terminal, plain lines in a log.

use super::arguments::Verbosity;
use super::jobs::Job;
use super::report::Report;
use crate::failure::Failure;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write, stderr};

/// A line on standard error. Where nobody reads it any more (a closed pipe, a full disk), the work goes on:
/// `eprintln!` would end it with a panic.
fn print_line(text: &str) {
    let _ = stderr().write_all(format!("{text}\n").as_bytes());
}

/// Lines and bar of a run; both go to standard error.
pub struct Progress {
    verbosity: Verbosity,
    frames: usize,
    bar: Option<ProgressBar>,
}

impl Progress {
    /// A bar when there are several frames and standard error is a terminal.
    pub fn new(verbosity: Verbosity, frames: usize) -> Self {
        let shown = frames > 1 && verbosity > Verbosity::Quiet && stderr().is_terminal();
        let bar = shown.then(|| {
            let style = ProgressStyle::with_template("{bar:32} {pos}/{len} frames  {eta} left");
            let bar =
                ProgressBar::new(frames as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()));
            bar.tick();
            bar
        });
        Self { verbosity, frames, bar }
    }

    fn line(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| print_line(text)),
            None => print_line(text),
        }
    }

    /// A line for everyone who did not ask for quiet.
    pub fn say(&self, text: &str) {
        if self.verbosity >= Verbosity::Normal {
            self.line(text);
        }
    }

    /// A line for those who asked for more.
    pub fn detail(&self, text: &str) {
        if self.verbosity >= Verbosity::Verbose {
            self.line(text);
        }
    }

    /// A frame is written.
    pub fn corrected(&self, job: &Job, report: &Report) {
        let Report { estimate, seconds, .. } = report;
        match &report.fallback {
            Some(reason) => self.say(&format!("{}: the picture is the denoiser's: {reason}", job.name())),
            None => self.say(&format!(
                "{}: estimated relL2 of the halves' mean {:.5} after {:.5} denoised, {:.2} s, {}",
                job.name(),
                estimate.corrected.value,
                estimate.denoised.value,
                seconds.total,
                job.output.display()
            )),
        }
        if let Some(unlike) = &report.unlike {
            self.say(&format!("{}: note: {unlike}", job.name()));
        }
        if let Some(after) = report.first_tile_after {
            self.detail(&format!("  first tile after {after:.3} s"));
        }
        self.detail(&format!(
            "  seconds: read {:.3}, features {:.3}, network {:.3}, g_c and judgement {:.3}, write {:.3}",
            seconds.read, seconds.features, seconds.network, seconds.finish, seconds.write
        ));
        if let Some(bytes) = report.peak_rss_bytes {
            self.detail(&format!("  most memory held so far: {} MiB", bytes >> 20));
        }
    }

    /// A frame of several could not be corrected. Printed even when quiet.
    pub fn failed(&self, job: &Job, failure: &Failure) {
        self.line(&format!("error: {}: {}", job.name(), failure.message));
    }

    /// How many frames are behind.
    pub fn frame_done(&self, done: usize) {
        if let Some(bar) = &self.bar {
            bar.set_position(done as u64);
            if done == self.frames {
                bar.finish_and_clear();
            }
        }
    }
}
