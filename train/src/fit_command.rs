//! `sspc-train fit`: read, prepare, train, correct, write.

use crate::cli::FitArgs;
use crate::fit::{Control, Limits};
use crate::fits::{Fits, fit_variants, starting_networks};
use crate::inputs::{Input, read};
use crate::outcome::{Outcome, correct_frame};
use crate::output_folder::OutputFolder;
use crate::preset::{Preset, Settings};
use crate::progress::{BAR, Progress, TRAINED};
use crate::report::{FitReport, FitSeconds, RelL2};
use crate::write::{Written, check_outputs, write_outputs};
use crate::{setting_overrides, warm_start};
use sspc_cli::output::{Output, role_line};
use sspc_cli::reading::check_variants;
use sspc_cli::record::{peak_rss_bytes, samples_line};
use sspc_cli::shot::Shot;
use sspc_cli::shot::settings::{MotionSearch, ShotSettings};
use sspc_cli::{Code, Denoising, Failure, FrameJob, UnaskedModes, interrupt};
use sspc_core::estimate::Mean;
use sspc_core::frame_sums::Verdict;
use sspc_core::objective::triple;
use sspc_core::prepare::Prepared;
use sspc_core::trust::Trust;
use sspc_core::useful::{LEAST_USEFUL, share_of_variant};
use sspc_kernels::features::DENOISED;
use sspc_kernels::network::Network;
use sspc_kernels::simd::Isa;
use std::time::{Duration, Instant};

/// Runs the command.
///
/// # Errors
/// A [`Failure`] with its exit code; nothing is left behind then.
pub fn run(args: &FitArgs) -> Result<(), Failure> {
    let start = Instant::now();
    let isa = Isa::from_env()?;
    args.run.start_threads()?;
    let output = Output::new(args.run.verbosity(), Some(BAR)).with_progress(args.run.progress);
    output.status("reading");
    let mut settings = Settings::of(args.preset, args.seed);
    setting_overrides::apply(&args.changes, &mut settings, args.init.is_some())?;
    let warm = args.init.as_deref().map(warm_start::read_model).transpose()?;
    let initial = warm.as_ref().map(|model| warm_start::begin(model, &mut settings));
    let overrides = args.frame.overrides()?;
    let all = args.frame.jobs(args.reference.as_deref())?;
    let jobs = training_frames(&all);
    if jobs.len() < all.len() {
        let names: Vec<String> = jobs.iter().filter_map(|job| job.number).map(|number| number.to_string()).collect();
        let (count, of, list) = (jobs.len(), all.len(), names.join(", "));
        output
            .say(&format!("fits to {count} of {of} frames: {list}; sspc-infer run corrects the others with the model"));
    }
    let unasked = match &warm {
        Some(model) => UnaskedModes::of_model(&model.contract.extra),
        // Nothing is corrected: z is all that is wanted.
        None if args.run.strength == 0.0 => None,
        None => Some(args.preset.denoising()),
    };
    let denoising = Denoising::new(&args.frame.denoise, unasked);
    let shot = if args.run.dry_run { None } else { shot(args, &jobs, &denoising, &output)? };
    let mut frames = Vec::new();
    for job in jobs {
        for view in args.frame.overrides_of_views(&job.files)? {
            if args.run.dry_run && denoising.describe_frame(&output, &job, &view)? {
                continue;
            }
            frames.push(read(job.clone(), shot.as_ref(), &view, &settings, &denoising, &args.frame.passes)?);
        }
    }
    let (mut inputs, mut prepared): (Vec<Input>, Vec<Prepared>) = frames.into_iter().unzip();
    inputs.iter().for_each(|input| say_what_was_read(&output, input));
    let read_seconds = start.elapsed().as_secs_f64();
    if args.run.dry_run {
        return Ok(());
    }
    let folder = OutputFolder::open(&args.output)?;
    check_outputs(&folder, args, &overrides, &inputs)?;

    let made = inputs.first().and_then(|input| input.denoiser.as_ref()).map_or(0, |denoiser| denoiser.modes.len());
    let left_out = leave_out_useless(&mut prepared, initial.is_some(), made);
    for note in left_out {
        output.say(&format!("  note: {note}"));
        inputs.iter_mut().for_each(|input| input.warnings.push(note.clone()));
    }
    let initial = initial_networks(initial, &mut settings, &prepared)?;
    // Without any of the correction there is nothing to train for.
    let steps = if args.run.strength == 0.0 { Some(0) } else { args.steps };
    let limits = Limits { steps, time: args.time_limit.map(Duration::from_secs_f64) };
    let frames: Vec<&Prepared> = prepared.iter().collect();
    let mut progress = Progress::new(&output, initial.len());
    let fitted = fit_variants(&frames, &settings, initial, &limits, args.backend, isa, |step| {
        progress.step(step);
        if interrupt::asked() { Control::Stop } else { Control::Continue }
    });
    progress.done();
    interrupt::check()?;
    output.progress(TRAINED);
    output.status("correcting and writing");

    let begin = Instant::now();
    let outcomes = inputs
        .iter_mut()
        .zip(prepared)
        .map(|(input, prepared)| {
            correct_frame(isa, args.run.strength, args.report, &settings, &fitted.networks, input, prepared)
        })
        .collect::<Result<Vec<Outcome>, _>>()?;
    let seconds = FitSeconds {
        read: read_seconds,
        train: fitted.seconds,
        correct: begin.elapsed().as_secs_f64(),
        ..FitSeconds::default()
    };
    let reports = inputs
        .iter()
        .zip(&outcomes)
        .map(|(input, outcome)| report(args, isa, &settings, input, &fitted, outcome, seconds))
        .collect();
    interrupt::check()?;
    let shot = shot.as_ref().map(|shot| *shot.settings());
    let written = Written { args, shot, settings: &settings, inputs: &inputs, fitted: &fitted, outcomes: &outcomes };
    write_outputs(&written, &overrides, reports, folder, start)?;
    outcomes.iter().zip(&inputs).for_each(|(outcome, input)| say_result(&output, input, outcome));
    output.progress(100.0);
    Ok(())
}

/// Frames of a shot that are trained on, at most: a model of eight serves a long shot as well as one of all its frames, and
/// time and memory stay bounded.
const MOST_FRAMES: usize = 8;

/// The frames to train on: all, or as many as are needed, spread evenly from the first to the last.
fn training_frames(all: &[FrameJob]) -> Vec<FrameJob> {
    let count = all.len().min(MOST_FRAMES);
    let place = |k: usize| k * (all.len() - 1) / (count - 1).max(1);
    (0..count).map(|k| all[place(k)].clone()).collect()
}

/// The shot whose neighbouring frames take part, with what its motion pass means.
fn shot<'a>(
    args: &FitArgs,
    jobs: &[FrameJob],
    denoising: &'a Denoising<'a>,
    output: &Output,
) -> Result<Option<Shot<'a>>, Failure> {
    // The paper knows single frames.
    let usual = if args.preset == Preset::Paper { 0 } else { 1 };
    let extra_frames = args.frame.extra_frames.unwrap_or(usual);
    let Some(files) = args.frame.shot_patterns()?.filter(|_| extra_frames > 0) else { return Ok(None) };
    let mut settings = ShotSettings { extra_frames, motion: [None; 2] };
    let searched = Shot::new(files.clone(), settings, denoising);
    let mut search = MotionSearch::default();
    for job in [jobs.first(), jobs.get(jobs.len() / 2), jobs.last()].into_iter().flatten() {
        let views = args.frame.overrides_of_views(&job.files)?;
        if let (Some(number), Some(view)) = (job.number, views.first()) {
            searched.look_for_motion(number, view, &mut search)?;
        }
    }
    let (motion, said) = search.finish();
    settings.motion = motion;
    said.iter().for_each(|line| output.say(line));
    Ok(Some(Shot::new(files, settings, denoising)))
}

/// Takes out of all frames the further denoised pictures that say nothing of the error of z: what is fitted is what would be
/// without them. The last `made` are a denoiser's, whose modes a model keeps. Where networks have `learned` already, they know
/// what they are given. A note for each that is left out.
pub fn leave_out_useless(prepared: &mut [Prepared], learned: bool, made: usize) -> Vec<String> {
    let count = prepared.first().map_or(0, |frame| frame.variants.len());
    if learned || prepared.iter().any(|frame| frame.variants.len() != count) {
        return Vec::new();
    }
    let mut notes = Vec::new();
    for k in (1..count.saturating_sub(made)).rev() {
        let share = share_of_variant(prepared, k);
        if share < LEAST_USEFUL {
            prepared.iter_mut().for_each(|frame| drop(frame.variants.remove(k)));
            notes.push(format!(
                "further denoised picture {k} leads nowhere from the first one (share {share:.4}): it is left out, and `run` must \
                 not be given it either"
            ));
        }
    }
    for frame in prepared {
        if let [only] = &frame.variants[..]
            && (0..2).all(|h| triple(&frame.halves[h], DENOISED).data() == only.halves[h].data())
        {
            frame.variants.clear();
        }
    }
    notes.reverse();
    notes
}

/// The networks to start from: as many as every frame has variants of z. Without `warm` ones, which have learned already,
/// the settings become those of networks that share the work.
///
/// # Errors
/// Frames, or frame and model, that differ in their number.
pub fn initial_networks(
    warm: Option<Vec<Network>>,
    settings: &mut Settings,
    prepared: &[Prepared],
) -> Result<Vec<Network>, Failure> {
    let count = prepared.first().map_or(1, Prepared::networks);
    if let Some(other) = prepared.iter().map(Prepared::networks).find(|n| *n != count) {
        let message = format!("one frame has {count} denoised pictures of each half, another {other}");
        return Err(Failure::new(Code::Input, message, "give every frame of a shot the same ones"));
    }
    match warm {
        None => {
            *settings = settings.clone().shared_by(count);
            Ok(starting_networks(settings, count))
        }
        Some(networks) => check_variants(networks.len(), count).map(|()| networks),
    }
}

fn report(
    args: &FitArgs,
    isa: Isa,
    settings: &Settings,
    input: &Input,
    fitted: &Fits,
    outcome: &Outcome,
    seconds: FitSeconds,
) -> FitReport {
    FitReport {
        version: env!("CARGO_PKG_VERSION").into(),
        preset: args.preset,
        seed: args.seed,
        backend: args.backend.to_string(),
        instruction_set: isa.name(),
        threads: rayon::current_num_threads(),
        width: input.denoised.width(),
        height: input.denoised.height(),
        exposure: input.stats.exposure,
        composition: settings.composition,
        strength: args.run.strength,
        steps: fitted.history.len(),
        steps_dropped: fitted.dropped,
        end: fitted.end,
        rel_l2: outcome.rel_l2.clone(),
        loss: outcome.verdict.loss,
        estimate: outcome.verdict.estimate,
        held_out_gain: outcome.verdict.held_out_gain,
        fallback: outcome.verdict.fallback.clone(),
        mean_share: outcome.mean_share,
        network_weights: outcome.network_weights.clone(),
        composite_share: outcome.composite_share,
        seconds,
        milliseconds_per_step: 1e3 * fitted.seconds / fitted.history.len().max(1) as f64,
        peak_rss_bytes: peak_rss_bytes(),
        found: input.stats.found,
        independence: input.stats.independence,
        roles: input.roles.iter().map(Into::into).collect(),
        samples: (&input.samples).into(),
        denoiser: input.denoiser.clone(),
        passes: outcome.passes.as_ref().map(|passes| passes.report.clone()),
        skipped: input.skipped.clone(),
        warnings: input.warnings.clone(),
        neighbours: input.neighbours.clone(),
        settings: settings.clone(),
        planned_steps: fitted.planned,
        history: fitted.history.clone(),
    }
}

fn say_what_was_read(output: &Output, input: &Input) {
    output.say(&format!("{}: {} x {} pixels", input.name, input.denoised.width(), input.denoised.height()));
    input.roles.iter().for_each(|source| output.say(&role_line(source)));
    output.say(&samples_line(&input.samples));
    input.denoiser.iter().for_each(|made| output.say(&made.line()));
    output.detail(&format!("  {}", input.stats.independence));
    input.neighbours.iter().for_each(|neighbour| output.detail(&neighbour.line()));
    input.warnings.iter().for_each(|warning| output.say(&format!("  note: {warning}")));
    input.passes.iter().flat_map(|passes| passes.lines()).for_each(|line| output.say(&line));
    output.say(&format!("  the picture replaces {}", input.output.channels().join(", ")));
    input.skipped.iter().for_each(|s| output.say(&format!("  skipped: {} ({})", s.what, s.why)));
}

fn say_result(output: &Output, input: &Input, outcome: &Outcome) {
    if let Some(reason) = &outcome.verdict.fallback {
        output.say(&format!("{}: the output is the denoiser's, {reason}", input.name));
    }
    // Estimates of halves that are not independent mean nothing.
    if !matches!(input.stats.trust(), Trust::None(_)) {
        say_estimate(output, &outcome.verdict);
    }
    if let Some(RelL2 { noisy, denoised, corrected, .. }) = outcome.rel_l2 {
        output.say(&format!(
            "relL2: noisy {noisy:.5}, denoised {denoised:.5}, corrected {corrected:.5} ({:.2} of the denoiser's)",
            corrected / denoised
        ));
    }
}

fn say_estimate(output: &Output, verdict: &Verdict) {
    let estimate = &verdict.estimate;
    let error = estimate.corrected.standard_error.map_or("uncertainty unknown".into(), |e| format!("± {e:.5}"));
    output.say(&format!(
        "estimated relL2 of the halves' mean: denoised {:.5}, corrected {:.5} {error}",
        estimate.denoised.value, estimate.corrected.value
    ));
    if let Some(Mean { value, standard_error: Some(error) }) = verdict.held_out_gain {
        output.detail(&format!("  gain over pixels that were not trained on: {value:.5} ± {error:.5} of loss"));
    }
}
