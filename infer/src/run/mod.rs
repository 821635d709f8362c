//! `run`: frames corrected with a fitted model, from file to file.
//!
//! | module | step |
//! |---|---|
//! | [`arguments`] | what can be asked, and where each picture goes |
//! | [`frame`] | one frame from file to file |
//! | `correction` | from its rows to its corrected picture and passes |
//! | [`shared`] | what all frames share |
//! | [`report`] | what the sidecar says |
//! | [`beside`], [`page`] | what the picture is compared with, and the page to look at |

pub mod arguments;
pub mod beside;
mod correction;
pub mod frame;
pub mod page;
pub mod report;
pub mod shared;

use crate::engine::Engine;
use arguments::{Job, RunArguments};
use page::PageOfRun;
use shared::Shared;
use sspc_cli::output::Output;
use sspc_cli::shot::Shot;
use sspc_cli::shot::settings::ShotSettings;
use sspc_cli::{Code, Denoising, Failure, UnaskedModes, interrupt};
use sspc_frames::atomic::check_output;
use sspc_kernels::simd::Isa;
use sspc_onnx::{Contract, load_model};
use std::path::PathBuf;

/// Runs the subcommand: every frame that can be corrected is, whatever happens to the others.
///
/// # Errors
/// A [`Failure`] with its exit code: the frame's own when there is one frame, else one that counts
/// the frames that failed.
pub fn run(arguments: &RunArguments) -> Result<(), Failure> {
    let isa = Isa::from_env()?;
    let overrides = arguments.frame.overrides()?;
    let jobs = arguments.jobs()?;
    let model = load_model(&arguments.model).map_err(|error| {
        let advice = "give a model.onnx that sspc-train fit or export wrote";
        Failure::new(Code::Input, error.to_string(), advice)
    })?;
    let engine = Engine::new(model, arguments.kernels.of(isa), arguments.tile);
    let bar = (jobs.len() > 1).then_some("{bar:32} {pos}/{len} frames  {eta} left");
    let output = Output::new(arguments.run.verbosity(), bar).with_progress(arguments.run.progress);
    let denoising = Denoising::new(&arguments.frame.denoise, UnaskedModes::of_model(&engine.model().contract.extra));
    let shot = shot(arguments, &engine.model().contract, &denoising, &output)?;
    let shared = Shared {
        arguments,
        overrides: &overrides,
        denoising: &denoising,
        shot: shot.as_ref(),
        engine: &engine,
        isa,
        output: &output,
    };
    arguments.run.start_threads()?;
    if arguments.run.dry_run {
        return all(&jobs, &output, |job| frame::describe(&shared, job));
    }
    if !arguments.report {
        return all(&jobs, &output, |job| frame::correct_file(&shared, job, None));
    }
    let protected: Vec<PathBuf> = jobs.iter().flat_map(|job| frame::inputs(&shared, job)).collect();
    let mut page = PageOfRun::new(&jobs);
    check_output(page.path(), &protected)?;
    let done = all(&jobs, &output, |job| {
        let done = frame::correct_file(&shared, job, Some(&mut page));
        done.inspect_err(|failure| page.add_failed(job, failure))
    });
    // What was corrected is shown, whatever happened to the others.
    if !matches!(&done, Err(failure) if failure.code == Code::Interrupted) {
        page.write(&jobs, &protected, &output)?;
    }
    done
}

/// The shot whose frames are read with their neighbours: as the model was fitted, unless the user says otherwise.
fn shot<'a>(
    arguments: &RunArguments,
    contract: &Contract,
    denoising: &'a Denoising<'a>,
    output: &Output,
) -> Result<Option<Shot<'a>>, Failure> {
    let fitted = ShotSettings::of_model(contract.extra_frames, &contract.extra).map_err(|error| {
        let message = format!("{}: {error}", arguments.model.display());
        Failure::new(Code::Input, message, "fit the model again, or run it with the version that fitted it")
    })?;
    let files = arguments.frame.shot_patterns()?;
    let extra_frames = arguments.frame.extra_frames.unwrap_or(fitted.extra_frames);
    if files.is_some() && extra_frames != fitted.extra_frames {
        output.say(&format!(
            "note: the model was fitted with {} neighbouring frames on each side and runs with {extra_frames}",
            fitted.extra_frames
        ));
    }
    if files.is_none() && fitted.extra_frames > 0 {
        output
            .say("note: the model was fitted with neighbouring frames; a frame by itself, not named by --a, has none");
    }
    let settings = ShotSettings { extra_frames, ..fitted };
    Ok(files.filter(|_| extra_frames > 0).map(|files| Shot::new(files, settings, denoising)))
}

/// Does every job; goes on after a bad input, ends at a failed output, which would fail again.
fn all(jobs: &[Job], output: &Output, mut work: impl FnMut(&Job) -> Result<(), Failure>) -> Result<(), Failure> {
    let mut failures: Vec<(String, Failure)> = Vec::new();
    show_done(output, 0, jobs.len());
    for (done, job) in jobs.iter().enumerate() {
        output.status(&job.frame.name());
        match interrupt::check().and_then(|()| work(job)) {
            Ok(()) => {}
            Err(failure) if failure.code == Code::Interrupted => return Err(failure),
            Err(failure) if jobs.len() == 1 => return Err(failure),
            Err(failure) => {
                let what = format!("{}: {}", job.frame.name(), failure.message);
                output.status(&what);
                output.always(&format!("error: {what}"));
                if !failure.advice.is_empty() {
                    output.always(&format!("advice: {}", failure.advice));
                }
                let hopeless = failure.code == Code::Run;
                failures.push((job.frame.name(), failure));
                if hopeless {
                    let left = jobs.len() - done - 1;
                    return Err(summary(&failures, jobs.len(), left));
                }
            }
        }
        show_done(output, done + 1, jobs.len());
    }
    if failures.is_empty() { Ok(()) } else { Err(summary(&failures, jobs.len(), 0)) }
}

fn show_done(output: &Output, done: usize, of: usize) {
    output.progress(100.0 * done as f64 / of as f64);
    if let Some(bar) = output.bar() {
        bar.set_length(of as u64);
        bar.set_position(done as u64);
        if done == of {
            bar.finish_and_clear();
        }
    }
}

fn summary(failures: &[(String, Failure)], frames: usize, untried: usize) -> Failure {
    /// Frames that are named; a log has them all.
    const NAMED: usize = 8;
    let worst = failures.iter().map(|(_, failure)| failure.code).max_by_key(|code| *code as u8).unwrap_or(Code::Run);
    let untried = if untried > 0 { format!(", {untried} not tried") } else { String::new() };
    let mut names: Vec<&str> = failures.iter().take(NAMED).map(|(name, _)| name.as_str()).collect();
    if failures.len() > NAMED {
        names.push("...");
    }
    let (failed, names) = (failures.len(), names.join(", "));
    let message = format!("{failed} of {frames} frames failed ({names}){untried}; the others are complete");
    Failure::new(worst, message, "mend what is named above and run again with --skip-existing")
}
