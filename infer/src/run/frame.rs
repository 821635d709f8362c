//! One frame from file to file.

use super::arguments::Job;
use super::beside::Beside;
use super::correction::{Corrections, correct_source};
use super::page::PageOfRun;
use super::report::{FrameReport, FrameSeconds, RelL2};
use super::shared::Shared;
use sspc_cli::output::{Output, print_result, role_line};
use sspc_cli::passes::{CorrectedPasses, FramePasses};
use sspc_cli::reading::{ReadFrame, check_variants};
use sspc_cli::record::samples_line;
use sspc_cli::shot::report::NeighbourReport;
use sspc_cli::shot::{Residence, ShotFrame};
use sspc_cli::{Code, DenoiserReport, Failure, interrupt, record};
use sspc_core::correct::Corrected;
use sspc_core::frame_stats::FrameStats;
use sspc_frames::atomic::{atomic_write_bytes, check_output};
use sspc_frames::read::Like;
use sspc_frames::samples::HalfSamples;
use sspc_frames::{OpenFrame, OutputPlan, RoleOverrides, read_reference};
use sspc_image::{FrameRows, HalfWeights, Image, Role, RoleSource};
use std::path::PathBuf;
use std::time::Instant;

/// Reads, corrects and writes one frame, or leaves it alone when its output is there and `--skip-existing` was given.
///
/// # Errors
/// A [`Failure`] with its exit code; nothing of the frame is written then.
pub fn correct_file(shared: &Shared, job: &Job, mut page: Option<&mut PageOfRun>) -> Result<(), Failure> {
    let Shared { arguments, output, .. } = *shared;
    if arguments.skip_existing && job.output.exists() {
        output.say(&format!("{}: {} exists, left alone", job.frame.name(), job.output.display()));
        return Ok(());
    }
    let inputs = inputs(shared, job);
    check_outputs(shared, job, &inputs)?;

    let start = Instant::now();
    let mut views = Vec::new();
    for overrides in arguments.frame.overrides_of_views(&job.frame.files)? {
        views.push(correct_view(shared, job, &overrides)?);
        interrupt::check()?;
    }
    let begin = Instant::now();
    let plan = plan_of(views.iter().map(|view| view.output.clone()))?;
    let pictures: Vec<&Image> = views.iter().flat_map(View::pictures).collect();
    plan.write(&job.output, &inputs, &pictures, &provenance(shared, &views[0]))?;
    let write = begin.elapsed().as_secs_f64();
    let count = views.len();
    for view in views {
        let View { corrected, passes, stats, roles, samples, denoiser, warnings, .. } = view;
        let (neighbours, read, name, beside, samples) =
            (view.neighbours, view.read, view.name, view.beside, (&samples).into());
        let seconds = FrameSeconds {
            read,
            features: corrected.seconds.features,
            correct: corrected.seconds.correct,
            write,
            total: start.elapsed().as_secs_f64(),
        };
        let rel_l2 = beside.as_ref().and_then(|beside| beside.rel_l2(&corrected.picture));
        let report = FrameReport::new(shared, job, &stats, &roles, warnings, &corrected, seconds);
        let passes = passes.map(|passes| passes.report);
        let report = FrameReport { samples, denoiser, neighbours, rel_l2, passes, ..report };
        if arguments.json {
            let json = serde_json::to_vec_pretty(&report)
                .map_err(|error| Failure::new(Code::Run, format!("cannot write the figures as JSON: {error}"), ""))?;
            atomic_write_bytes(&job.sidecar(name.as_deref()), &inputs, &json)?;
        }
        if let Some((page, beside)) = page.as_mut().zip(beside) {
            page.add(job, name.as_deref(), count, &report, beside, &corrected)?;
        }
        say_result(output, job, &report);
    }
    Ok(())
}

/// One view of a frame, corrected.
struct View {
    /// Where all views are corrected.
    name: Option<String>,
    output: OutputPlan,
    corrected: Corrected,
    passes: Option<CorrectedPasses>,
    stats: FrameStats,
    roles: Vec<RoleSource>,
    samples: HalfSamples,
    denoiser: Option<DenoiserReport>,
    warnings: Vec<String>,
    neighbours: Vec<NeighbourReport>,
    /// Seconds.
    read: f64,
    /// Where the picture is shown or measured.
    beside: Option<Beside>,
}

impl View {
    /// In the order of its output.
    fn pictures(&self) -> impl Iterator<Item = &Image> {
        [&self.corrected.picture].into_iter().chain(self.passes.iter().flat_map(|passes| &passes.pictures))
    }
}

fn correct_view(shared: &Shared, job: &Job, overrides: &RoleOverrides) -> Result<View, Failure> {
    let Shared { arguments, engine, .. } = *shared;
    let start = Instant::now();
    let contract = &engine.model().contract;
    let overrides = &wanted(shared, overrides.clone());
    let in_shot = shared.shot.zip(job.frame.number);
    let mut open = match in_shot {
        Some((shot, number)) => shot.open(number, overrides)?,
        None => OpenFrame::open_to_denoise(&job.frame.files, overrides)?,
    };
    let (mut output, placing) = (open.output()?, open.placing());
    let said: Vec<String> = open.note_on_differences().into_iter().collect();
    let mut passes = arguments.frame.passes.find(&open, shared.denoising)?;
    if let Some(passes) = &passes {
        output = output.and(passes.output()?)?;
        passes.lines().iter().for_each(|line| shared.output.say(line));
    }
    let ShotFrame { frame, denoiser, neighbours } = match in_shot {
        Some((shot, number)) => shot.read(number, open, overrides, contract.exposure, Residence::AsFits)?,
        None => {
            let denoiser = shared.denoising.supply(&mut open)?;
            ShotFrame { frame: ReadFrame::read(open, contract.exposure)?, denoiser, neighbours: Vec::new() }
        }
    };
    let shows = arguments.report || arguments.reference.is_some();
    let reference = job.frame.files.reference.as_ref().filter(|_| shows);
    let like = Like { path: &job.frame.files.a, placing };
    let reference = reference.map(|path| read_reference(path, Some(like))).transpose()?;
    let read = start.elapsed().as_secs_f64();
    say_what_was_read(shared, job, &frame, denoiser.as_ref());
    neighbours.iter().for_each(|neighbour| shared.output.detail(&neighbour.line()));

    let beside = shows.then(|| Beside::read(&frame.source, frame.different.as_ref(), reference)).transpose()?;
    let ReadFrame { mut source, stats, roles, samples, mut warnings, .. } = frame;
    if let Some(composite) = passes.as_mut().and_then(FramePasses::take_composite) {
        source.set_composite(composite);
    }
    check_variants(contract.networks, source.variants().max(1))?;
    let stats = stats.with_features_of(contract.features);
    said.iter().for_each(|note| shared.output.say(&format!("{}: note: {note}", job.frame.name())));
    warnings.extend(said);
    let Corrections { corrected, passes, notes } =
        correct_source(shared, &job.frame.name(), source, stats, passes, &output)?;
    warnings.extend(notes);
    let name = overrides.view().filter(|_| overrides.all_views()).map(str::to_string);
    Ok(View { name, output, corrected, passes, stats, roles, samples, denoiser, warnings, neighbours, read, beside })
}

/// The same overrides, with differences of y looked for where the model is of a fit with some.
fn wanted(shared: &Shared, overrides: RoleOverrides) -> RoleOverrides {
    if shared.engine.model().contract.differences > 0.0 { overrides.with_differences() } else { overrides }
}

/// One file of the pictures of all views.
fn plan_of(mut plans: impl Iterator<Item = OutputPlan>) -> Result<OutputPlan, Failure> {
    let first = plans.next().ok_or_else(|| Failure::new(Code::Input, "a frame without views", ""))?;
    Ok(plans.try_fold(first, OutputPlan::and)?)
}

/// Says what [`correct_file`] would do, reading headers only.
///
/// # Errors
/// What would stop the frame, as a [`Failure`].
pub fn describe(shared: &Shared, job: &Job) -> Result<(), Failure> {
    let mut lines = vec![format!("{}:", job.frame.name())];
    let exists = job.output.exists();
    if shared.arguments.skip_existing && exists {
        lines.push(format!("  would be left alone: {} exists", job.output.display()));
    } else {
        check_outputs(shared, job, &inputs(shared, job))?;
        let mut plans = Vec::new();
        for overrides in shared.arguments.frame.overrides_of_views(&job.frame.files)? {
            let overrides = wanted(shared, overrides);
            let open = match shared.shot.zip(job.frame.number) {
                Some((shot, number)) => shot.open(number, &overrides)?,
                None => OpenFrame::open_to_denoise(&job.frame.files, &overrides)?,
            };
            lines.extend(open.note_on_differences().map(|note| format!("  note: {note}")));
            lines.extend(open.sources().iter().map(role_line));
            lines.push(samples_line(open.samples()));
            lines.extend(shared.denoising.describe(&open)?);
            lines.extend(open.notes().iter().map(|note| format!("  note: {note}")));
            lines.extend(shared.arguments.frame.passes.describe(&open)?);
            plans.push(open.output()?);
        }
        let plan = plan_of(plans.into_iter())?;
        lines.push(format!("  the picture replaces {}", plan.channels().join(", ")));
        let verb = if exists { "replace" } else { "write" };
        lines.push(format!("  would {verb} {}", job.output.display()));
    }
    print_result(&(lines.join("\n") + "\n"))
}

/// Files that must not be overwritten.
pub fn inputs(shared: &Shared, job: &Job) -> Vec<PathBuf> {
    let mut inputs = job.frame.files.all();
    inputs.extend(shared.overrides.files());
    inputs.push(shared.arguments.model.clone());
    inputs
}

fn check_outputs(shared: &Shared, job: &Job, inputs: &[PathBuf]) -> Result<(), Failure> {
    check_output(&job.output, inputs)?;
    if shared.arguments.json {
        check_output(&job.sidecar(None), inputs)?;
    }
    Ok(())
}

fn say_what_was_read(shared: &Shared, job: &Job, frame: &ReadFrame, denoiser: Option<&DenoiserReport>) {
    let (output, name) = (shared.output, job.frame.name());
    output.detail(&format!("{name}: {} x {} pixels", frame.source.width(), frame.source.height()));
    frame.roles.iter().for_each(|source| output.detail(&role_line(source)));
    let line = samples_line(&frame.samples);
    match frame.samples.weights() == HalfWeights::EQUAL {
        true => output.detail(&line),
        false => output.say(&format!("{name}:{}", &line[1..])),
    }
    denoiser.iter().for_each(|made| output.say(&format!("{name}:{}", &made.line()[1..])));
    frame.warnings.iter().for_each(|warning| output.say(&format!("{name}: note: {warning}")));
    let fitted = shared.engine.model().contract.features;
    let has = |role: Role| frame.roles.iter().any(|source| source.role == role);
    for role in Role::FEATURES {
        if has(role) && !fitted.has(role) {
            output.detail(&format!("  {role} is left out: the model was fitted without it"));
        }
    }
}

fn say_result(output: &Output, job: &Job, report: &FrameReport) {
    let (name, estimate, seconds) = (job.frame.name(), &report.estimate, report.seconds);
    match &report.fallback {
        Some(reason) => output.say(&format!("{name}: the picture is the denoiser's: {reason}")),
        None => output.say(&format!(
            "{name}: estimated relL2 of the halves' mean {:.5} after {:.5} denoised, {:.2} s, {}",
            estimate.corrected.value,
            estimate.denoised.value,
            seconds.total,
            job.output.display()
        )),
    }
    if let Some(RelL2 { noisy, denoised, corrected, .. }) = report.rel_l2 {
        output.say(&format!(
            "{name}: relL2: noisy {noisy:.5}, denoised {denoised:.5}, corrected {corrected:.5} ({:.2} of the denoiser's)",
            corrected / denoised
        ));
    }
    if let Some(unlike) = &report.unlike {
        output.say(&format!("{name}: note: {unlike}"));
    }
    if let Some(after) = report.first_tile_after {
        output.detail(&format!("  first tile after {after:.3} s"));
    }
    output.detail(&format!(
        "  seconds: read {:.3}, features {:.3}, network, g_c and weights {:.3}, write {:.3}",
        seconds.read, seconds.features, seconds.correct, seconds.write
    ));
    if let Some(bytes) = report.peak_rss_bytes {
        output.detail(&format!("  most memory held so far: {} MiB", bytes >> 20));
    }
}

/// How the picture was made, for its attributes.
fn provenance(shared: &Shared, view: &View) -> Vec<(String, String)> {
    let contract = &shared.engine.model().contract;
    let mut own = vec![
        ("sspc.model", record::shown_path(&shared.arguments.model)),
        ("sspc.model_frames", contract.frames.join(" ")),
        ("sspc.model_preset", contract.preset.clone()),
    ];
    own.extend(view.denoiser.iter().map(|made| ("sspc.denoiser", made.provenance())));
    record::provenance("sspc-infer", &own, shared.arguments.run.strength, view.corrected.verdict.fallback.as_deref())
}
