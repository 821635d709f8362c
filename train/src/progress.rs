//! Progress of training: a bar on a terminal, plain lines in a log, messages on a farm.

use crate::fit::StepRecord;
use sspc_cli::output::Output;
use std::time::{Duration, Instant};

/// Plain lines come at least this far apart.
const LINE_INTERVAL: Duration = Duration::from_secs(2);
/// Percentage of a fit's work that is done when training ends; the rest is correction and files.
pub const TRAINED: f64 = 90.0;
/// The bar.
pub const BAR: &str = "training {bar:32} {pos}/{len}  {per_sec}  {msg}  {eta} left";

/// Tells the steps of a training.
pub struct Progress<'a> {
    output: &'a Output,
    last_line: Option<Instant>,
    /// Networks to train, one after the other, and how many are done.
    networks: usize,
    trained: usize,
}

impl<'a> Progress<'a> {
    /// Of a training of so many networks that has not begun.
    pub fn new(output: &'a Output, networks: usize) -> Self {
        Self { output, last_line: None, networks: networks.max(1), trained: 0 }
    }

    /// A step was taken.
    pub fn step(&mut self, step: &StepRecord) {
        if let Some(bar) = self.output.bar() {
            bar.set_length(step.of as u64);
            bar.set_position(step.step as u64);
            bar.set_message(format!("loss {:.5}", step.loss));
        }
        let due = self.last_line.is_none_or(|at| at.elapsed() >= LINE_INTERVAL);
        let told = self.output.in_lines() || self.output.in_messages();
        if told && (due || step.step == step.of) {
            let rate = step.step as f64 / step.seconds.max(1e-9);
            let left = (step.of - step.step) as f64 / rate;
            let line = format!(
                "training step {}/{}, loss {:.5}, {rate:.1} steps/s, {left:.0} s left",
                step.step, step.of, step.loss
            );
            let trained = (self.trained as f64 + step.step as f64 / step.of as f64) / self.networks as f64;
            self.output.progress(TRAINED * trained);
            self.output.status(&line);
            if self.output.in_lines() {
                self.output.say(&line);
            }
            self.last_line = Some(Instant::now());
        }
        if step.step == step.of {
            self.trained += 1;
        }
    }

    /// Training ended.
    pub fn done(self) {
        if let Some(bar) = self.output.bar() {
            bar.finish_and_clear();
        }
    }
}
