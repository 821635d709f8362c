//! Progress of a fit: a bar on a terminal, plain lines in a log.

use crate::fit::Step;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::{IsTerminal, Write, stderr};
use std::time::{Duration, Instant};

/// Plain lines come at least this far apart.
const LINE_INTERVAL: Duration = Duration::from_secs(2);

/// A line on standard error. Where nobody reads it any more (a closed pipe, a full disk), the work goes on:
/// `eprintln!` would end it with a panic.
pub fn print_line(line: &str) {
    let _ = stderr().write_all(format!("{line}\n").as_bytes());
}

/// Where progress goes.
pub enum Progress {
    Quiet,
    Bar(ProgressBar),
    Lines { last: Option<Instant> },
}

impl Progress {
    /// A bar when standard error is a terminal, lines when it is not, nothing when `quiet`.
    pub fn new(quiet: bool) -> Self {
        if quiet {
            return Progress::Quiet;
        }
        if !stderr().is_terminal() {
            return Progress::Lines { last: None };
        }
        let style = ProgressStyle::with_template("training {bar:32} {pos}/{len}  {per_sec}  {msg}  {eta} left");
        Progress::Bar(ProgressBar::new(0).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar())))
    }

    /// One line for the person or the log.
    pub fn say(&self, line: &str) {
        match self {
            Progress::Quiet => {}
            Progress::Bar(bar) => bar.suspend(|| print_line(line)),
            Progress::Lines { .. } => print_line(line),
        }
    }

    pub fn step(&mut self, step: &Step) {
        match self {
            Progress::Quiet => {}
            Progress::Bar(bar) => {
                bar.set_length(step.of as u64);
                bar.set_position(step.step as u64);
                bar.set_message(format!("loss {:.5}", step.loss));
            }
            Progress::Lines { last } => {
                let due = last.is_none_or(|at| at.elapsed() >= LINE_INTERVAL);
                if due || step.step == step.of {
                    let rate = step.step as f64 / step.seconds.max(1e-9);
                    let left = (step.of - step.step) as f64 / rate;
                    print_line(&format!(
                        "training step {}/{}, loss {:.5}, {rate:.1} steps/s, {left:.0} s left",
                        step.step, step.of, step.loss
                    ));
                    *last = Some(Instant::now());
                }
            }
        }
    }

    pub fn done(&self) {
        if let Progress::Bar(bar) = self {
            bar.finish_and_clear();
        }
    }
}
