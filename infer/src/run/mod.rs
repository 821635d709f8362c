//! `run`: frames corrected with a fitted model, from file to file.
//!
//! | module | step |
//! |---|---|
//! | [`arguments`] | what can be asked |
//! | [`jobs`] | which files make which frame, and where its picture goes |
//! | [`source`] | where a frame's rows come from |
//! | [`correct`] | one frame from pixels to pixels, in bands of bounded memory |
//! | [`frame`] | one frame from file to file |
//! | [`report`] | what the sidecar says |
//! | [`progress`] | what the person sees |

pub mod arguments;
pub mod correct;
pub mod frame;
pub mod jobs;
pub mod progress;
pub mod report;
pub mod source;

use crate::engine::Engine;
use crate::failure::{Code, Failure};
use crate::interrupt;
use arguments::RunArguments;
use frame::Setting;
use jobs::Job;
use progress::Progress;
use sspc_frames::RoleOverrides;
use sspc_kernels::simd::Isa;
use sspc_onnx::load_model;

/// Runs the subcommand: every frame that can be corrected is, whatever happens to the others.
///
/// # Errors
/// A [`Failure`] with its exit code: the frame's own when there is one frame, else one that counts
/// the frames that failed.
pub fn run(arguments: &RunArguments) -> Result<(), Failure> {
    let overrides = RoleOverrides::parse(&arguments.roles)?;
    let jobs = jobs::list(arguments)?;
    let model = load_model(&arguments.model).map_err(|error| {
        let advice = "give a model.onnx that sspc-train fit or export wrote";
        Failure::new(Code::Input, error.to_string(), advice)
    })?;
    let isa = Isa::best();
    let engine = Engine::new(model, arguments.kernels.of(isa), arguments.tile);
    let progress = Progress::new(arguments.verbosity(), jobs.len());
    let setting = Setting { arguments, overrides: &overrides, engine: &engine, isa, progress: &progress };
    limit_threads(arguments.threads)?;
    if arguments.dry_run {
        return all(&jobs, &progress, |job| frame::describe(&setting, job));
    }
    all(&jobs, &progress, |job| frame::correct_file(&setting, job))
}

/// Does every job; goes on after a bad input, ends at a failed output, which would fail again.
fn all(jobs: &[Job], progress: &Progress, work: impl Fn(&Job) -> Result<(), Failure>) -> Result<(), Failure> {
    let mut failures: Vec<Failure> = Vec::new();
    for (done, job) in jobs.iter().enumerate() {
        match interrupt::check().and_then(|()| work(job)) {
            Ok(()) => {}
            Err(failure) if failure.code == Code::Interrupted => return Err(failure),
            Err(failure) if jobs.len() == 1 => return Err(failure),
            Err(failure) => {
                progress.failed(job, &failure);
                let hopeless = failure.code == Code::Run;
                failures.push(failure);
                if hopeless {
                    let left = jobs.len() - done - 1;
                    return Err(summary(&failures, jobs.len(), left));
                }
            }
        }
        progress.frame_done(done + 1);
    }
    if failures.is_empty() { Ok(()) } else { Err(summary(&failures, jobs.len(), 0)) }
}

fn summary(failures: &[Failure], frames: usize, untried: usize) -> Failure {
    let worst = failures.iter().map(|f| f.code).max_by_key(|code| *code as u8).unwrap_or(Code::Run);
    let untried = if untried > 0 { format!(", {untried} not tried") } else { String::new() };
    let message = format!("{} of {frames} frames failed{untried}; the others are complete", failures.len());
    Failure::new(worst, message, "mend what is named above and run again with --skip-existing")
}

fn limit_threads(threads: Option<usize>) -> Result<(), Failure> {
    let Some(threads) = threads else { return Ok(()) };
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|error| Failure::new(Code::Run, format!("cannot start {threads} threads: {error}"), "ask for fewer"))
}
