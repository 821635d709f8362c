//! One frame from file to file.

use super::arguments::RunArguments;
use super::correct::{CorrectError, Corrected, Options, correct_rows};
use super::jobs::Job;
use super::progress::Progress;
use super::report::{Looks, Report, Seconds};
use super::source::Surveyed;
use crate::engine::Engine;
use crate::failure::{Code, Failure};
use crate::interrupt;
use sspc_frames::atomic::{atomic_write_bytes, check_output};
use sspc_frames::resolve::resolve;
use sspc_frames::{OpenFrame, RoleOverrides, write_corrected};
use sspc_image::Role;
use sspc_kernels::simd::Isa;
use std::path::PathBuf;
use std::time::Instant;

/// What all frames of a run share.
pub struct Setting<'a> {
    pub arguments: &'a RunArguments,
    pub overrides: &'a RoleOverrides,
    pub engine: &'a Engine,
    pub isa: Isa,
    pub progress: &'a Progress,
}

/// Reads, corrects and writes one frame, or leaves it alone when its output is there and
/// `--skip-existing` was given.
///
/// # Errors
/// A [`Failure`] with its exit code; nothing of the frame is written then.
pub fn correct_file(setting: &Setting, job: &Job) -> Result<(), Failure> {
    let Setting { arguments, overrides, engine, isa, progress } = setting;
    if arguments.skip_existing && job.output.exists() {
        progress.say(&format!("{}: {} exists, left alone", job.name(), job.output.display()));
        return Ok(());
    }
    let inputs = inputs(setting, job);
    check_outputs(setting, job, &inputs)?;

    let start = Instant::now();
    let mut seconds = Seconds::default();
    let open = OpenFrame::open(&job.files, overrides)?;
    let looks = Looks { height: open.height(), width: open.width(), sources: open.sources() };
    let frame = Surveyed::read(open, engine.model().contract.exposure)?;
    seconds.read = start.elapsed().as_secs_f64();
    tell_what_was_read(setting, job, &looks, &frame.warnings);

    let Surveyed { rows, survey, warnings } = frame;
    let options = Options { strength: arguments.strength, ..Options::default() };
    let corrected =
        correct_rows(engine, *isa, &*rows, survey, options, &mut seconds, &interrupt::asked).map_err(|error| {
            match error {
                CorrectError::Interrupted => Failure::interrupted(),
                CorrectError::Plan(error) => Failure::new(Code::Run, error.to_string(), "try --kernels fused"),
                CorrectError::Read(error) => error.into(),
            }
        })?;
    drop(rows);
    let mut report = Report::new(setting, job, looks, warnings, &corrected);
    interrupt::check()?;

    let begin = Instant::now();
    write_corrected(&job.output, &job.files.a, &inputs, &corrected.picture, &provenance(setting, &corrected))?;
    seconds.write = begin.elapsed().as_secs_f64();
    seconds.total = start.elapsed().as_secs_f64();
    report.finish(seconds);
    if arguments.json {
        atomic_write_bytes(&job.sidecar(), &inputs, &report.to_json())?;
    }
    progress.corrected(job, &report);
    Ok(())
}

/// Says what [`correct_file`] would do, reading headers only.
///
/// # Errors
/// What would stop the frame, as a [`Failure`].
pub fn describe(setting: &Setting, job: &Job) -> Result<(), Failure> {
    let mut lines = vec![format!("{}:", job.name())];
    let exists = job.output.exists();
    if setting.arguments.skip_existing && exists {
        lines.push(format!("  would be left alone: {} exists", job.output.display()));
    } else {
        check_outputs(setting, job, &inputs(setting, job))?;
        let found = resolve(&job.files, setting.overrides)?;
        for source in found.filled.iter().map(|filled| found.source(filled)) {
            let channels = source.channels.join(",");
            lines.push(format!("  {} of {} from {} [{channels}]", source.role, source.buffer, source.path.display()));
        }
        lines.extend(found.warnings.iter().map(|warning| format!("  note: {warning}")));
        let verb = if exists { "replace" } else { "write" };
        lines.push(format!("  would {verb} {}", job.output.display()));
    }
    println_all(&lines)
}

fn println_all(lines: &[String]) -> Result<(), Failure> {
    use std::io::Write;
    let mut out = std::io::stdout().lock();
    let text = lines.join("\n") + "\n";
    out.write_all(text.as_bytes()).and_then(|()| out.flush()).map_err(|error| Failure::from_stdout(&error))
}

/// Files that must not be overwritten.
fn inputs(setting: &Setting, job: &Job) -> Vec<PathBuf> {
    let mut inputs = job.files.all();
    inputs.extend(setting.overrides.files());
    inputs.push(setting.arguments.model.clone());
    inputs
}

fn check_outputs(setting: &Setting, job: &Job, inputs: &[PathBuf]) -> Result<(), Failure> {
    check_output(&job.output, inputs)?;
    if setting.arguments.json {
        check_output(&job.sidecar(), inputs)?;
    }
    Ok(())
}

fn tell_what_was_read(setting: &Setting, job: &Job, frame: &Looks, warnings: &[String]) {
    let progress = setting.progress;
    progress.detail(&format!("{}: {} x {} pixels", job.name(), frame.width, frame.height));
    for source in &frame.sources {
        let channels = source.channels.join(",");
        progress.detail(&format!("  {} of {} from {} [{channels}]", source.role, source.buffer, source.path.display()));
    }
    warnings.iter().for_each(|warning| progress.say(&format!("{}: note: {warning}", job.name())));
    let fitted = setting.engine.model().contract.features;
    let has = |role: Role| frame.sources.iter().any(|source| source.role == role);
    for (role, used) in
        [(Role::Albedo, fitted.albedo), (Role::Normal, fitted.normal), (Role::Visibility, fitted.visibility)]
    {
        if has(role) && !used {
            progress.detail(&format!("  {role} is left out: the model was fitted without it"));
        }
    }
}

/// How the picture was made, for its attributes.
fn provenance(setting: &Setting, corrected: &Corrected) -> Vec<(String, String)> {
    let contract = &setting.engine.model().contract;
    [
        ("sspc.tool", concat!("sspc-infer ", env!("CARGO_PKG_VERSION")).to_string()),
        ("sspc.model", setting.arguments.model.display().to_string()),
        ("sspc.model_frames", contract.frames.join(" ")),
        ("sspc.model_preset", contract.preset.clone()),
        ("sspc.strength", setting.arguments.strength.to_string()),
        ("sspc.fallback", corrected.fallback.clone().unwrap_or_else(|| "none".into())),
    ]
    .map(|(key, value)| (key.to_string(), value))
    .to_vec()
}
