//! What a person sees: lines, and a bar on a terminal; and what a farm reads instead of the bar.

use crate::failure::Failure;
use crate::openjd;
use crate::print::print_line;
use crate::run_args::{ProgressFormat, Verbosity};
use indicatif::{ProgressBar, ProgressStyle};
use sspc_image::RoleSource;
use std::io::{IsTerminal, Write, stderr, stdout};

/// Lines and bar of a command; both go to standard error. A farm's messages go to standard output.
pub struct Output {
    verbosity: Verbosity,
    format: ProgressFormat,
    bar: Option<ProgressBar>,
}

impl Output {
    /// With a bar of this template when standard error is a terminal.
    pub fn new(verbosity: Verbosity, template: Option<&str>) -> Self {
        let shown = verbosity > Verbosity::Quiet && stderr().is_terminal();
        let bar = template.filter(|_| shown).map(|template| {
            let style = ProgressStyle::with_template(template).unwrap_or_else(|_| ProgressStyle::default_bar());
            ProgressBar::new(0).with_style(style)
        });
        Self { verbosity, format: ProgressFormat::Auto, bar }
    }

    /// The same with progress told as asked for: a farm's messages take the place of the bar.
    pub fn with_progress(self, format: ProgressFormat) -> Self {
        let bar = self.bar.filter(|_| format == ProgressFormat::Auto);
        Self { format, bar, ..self }
    }

    /// Tells a farm which percentage of the work is done.
    pub fn progress(&self, percent: f64) {
        if self.format == ProgressFormat::Openjd {
            openjd::progress(percent);
        }
    }

    /// Tells a farm what is being done.
    pub fn status(&self, text: &str) {
        if self.format == ProgressFormat::Openjd {
            openjd::status(text);
        }
    }

    /// The bar, where there is one.
    pub fn bar(&self) -> Option<&ProgressBar> {
        self.bar.as_ref()
    }

    /// Whether progress is to be told in lines: nobody watches a bar or reads messages, and quiet was not asked for.
    pub fn in_lines(&self) -> bool {
        self.bar.is_none() && self.verbosity > Verbosity::Quiet && self.format == ProgressFormat::Auto
    }

    /// Whether progress is told to a farm.
    pub fn in_messages(&self) -> bool {
        self.format == ProgressFormat::Openjd
    }

    /// A line whatever was asked for.
    pub fn always(&self, line: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| print_line(line)),
            None => print_line(line),
        }
    }

    /// A line for everyone who did not ask for quiet.
    pub fn say(&self, line: &str) {
        if self.verbosity >= Verbosity::Normal {
            self.always(line);
        }
    }

    /// A line for those who asked for more.
    pub fn detail(&self, line: &str) {
        if self.verbosity >= Verbosity::Verbose {
            self.always(line);
        }
    }
}

/// Which channel fills a role, as a line.
pub fn role_line(source: &RoleSource) -> String {
    let channels = source.channels.join(",");
    let role = role_name(source);
    format!("  {role} of {} from {} [{channels}]", source.buffer, source.path.display())
}

/// What messages call a role; further denoised pictures have numbers.
pub fn role_name(source: &RoleSource) -> String {
    match source.variant {
        0 => source.role.to_string(),
        number => format!("further {} {number}", source.role),
    }
}

/// Text to standard output, all of it.
///
/// # Errors
/// When it is closed or full.
pub fn print_result(text: &str) -> Result<(), Failure> {
    let mut out = stdout().lock();
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|error| Failure::from_stdout(&error))
}
