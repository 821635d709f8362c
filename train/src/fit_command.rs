//! `sspc-train fit`: read, prepare, train, correct, write.

use crate::cli::FitArgs;
use crate::error::Error;
use crate::experiment;
use crate::fit::{Control, Fitted, Limits, fit};
use crate::inputs::{Input, frame_files, read, read_shot};
use crate::interrupt::interrupted;
use crate::output::OutputFolder;
use crate::preset::Settings;
use crate::progress::Progress;
use crate::report::{RelL2, Report, Seconds, peak_rss_bytes, settings_json, skipped};
use crate::start::starting_network;
use crate::write::{check_outputs, write_outputs};
use sspc_core::corrector::parameters;
use sspc_core::finish::{Composition, Finished, finish, picture};
use sspc_core::frame::Frame;
use sspc_core::gc::Taps;
use sspc_core::image::Image;
use sspc_core::io::RoleOverrides;
use sspc_core::network::Network;
use sspc_core::plan::Plan;
use sspc_core::prepare::{Prepared, Survey};
use sspc_core::simd::Isa;
use std::time::{Duration, Instant};

/// Runs the command.
///
/// # Errors
/// Every [`Error`]; nothing is left behind then.
pub fn run(args: &FitArgs) -> Result<(), Error> {
    let start = Instant::now();
    let mut progress = Progress::new(args.quiet);
    let mut settings = Settings::of(args.preset, args.seed);
    experiment::apply(&args.changes, &mut settings, args.init.is_some())?;
    let initial = match &args.init {
        Some(path) => crate::init::load(path, &mut settings)?,
        None => starting_network(&settings),
    };
    let overrides = RoleOverrides::parse(&args.roles)?;
    let inputs = match args.a {
        Some(_) => read_shot(args, &overrides)?,
        None => vec![read(frame_files(args)?, &overrides)?],
    };
    let prepared: Vec<Prepared> = inputs.iter().map(|input| prepare(input, &settings)).collect();
    say_what_was_read(&progress, &inputs, &prepared);
    let read_seconds = start.elapsed().as_secs_f64();
    if args.dry_run {
        return Ok(());
    }
    let folder = OutputFolder::open(&args.output)?;
    check_outputs(&folder, args, &inputs)?;

    let limits = Limits { steps: args.steps, time: args.time_limit.map(Duration::from_secs_f64) };
    let isa = Isa::best();
    let frames: Vec<&Prepared> = prepared.iter().collect();
    let fitted = fit(&frames, &settings, initial, &limits, args.backend, isa, |step| {
        progress.step(step);
        if interrupted() { Control::Stop } else { Control::Continue }
    });
    progress.done();
    if interrupted() {
        return Err(Error::Interrupted);
    }

    let begin = Instant::now();
    let results: Vec<Outcome> = inputs
        .iter()
        .zip(&prepared)
        .map(|(input, prepared)| correct_frame(isa, &settings, &fitted.network, input, prepared))
        .collect();
    let seconds = Seconds {
        read: read_seconds,
        train: fitted.seconds,
        correct: begin.elapsed().as_secs_f64(),
        ..Seconds::default()
    };
    let reports = inputs
        .iter()
        .zip(&prepared)
        .zip(&results)
        .map(|((input, prepared), result)| report(args, &settings, input, prepared, &fitted, result, seconds))
        .collect();
    if interrupted() {
        return Err(Error::Interrupted);
    }
    write_outputs(args, &settings, &inputs, &prepared, &fitted, &results, reports, folder, start)?;
    results.iter().zip(&inputs).for_each(|(result, input)| say_result(&progress, input, result));
    Ok(())
}

/// A frame in the method's units, with the features that the settings allow. The paper computes
/// every pixel, but its rate leaves nothing to compute where no pixel has noise. Features kept
/// without need stay zeros, so that the picture is the same.
fn prepare(input: &Input, settings: &Settings) -> Prepared {
    let survey = Survey::of(&input.frame, settings.exposure).with_features_of(settings.features);
    let mut prepared = Prepared::by_survey(&input.frame, survey);
    let whole = settings.composition == Composition::MeanOfHalves || !settings.skip.blocks;
    if whole && prepared.plan.active_share > 0.0 {
        prepared.plan = Plan::everything(prepared.height(), prepared.width());
    }
    if !settings.skip.features {
        prepared.set = settings.features;
    }
    prepared
}

/// A corrected frame.
pub struct Outcome {
    /// In the frame's units, `[3, H, W]`.
    pub corrected: Image,
    pub finished: Finished,
    pub rel_l2: Option<RelL2>,
}

fn correct_frame(isa: Isa, settings: &Settings, network: &Network, input: &Input, prepared: &Prepared) -> Outcome {
    let taps = Taps::square(settings.radius);
    let planes = [0, 1].map(|h| parameters(isa, settings.form, network, &prepared.halves[h], &prepared.plan));
    let finished = finish(isa, settings.form, &taps, settings.composition, prepared, [&planes[0], &planes[1]]);
    let corrected = picture(&input.frame, prepared, &finished);
    let measure = |r| {
        RelL2::measure(&noisy(&input.frame), &denoised(&input.frame), &corrected, r).with_halves(
            &input.frame,
            prepared,
            &finished,
            r,
        )
    };
    let rel_l2 = input.reference.as_ref().map(measure);
    Outcome { corrected, finished, rel_l2 }
}

/// Mean of both halves' radiance.
pub fn noisy(frame: &Frame) -> Image {
    Image::mean_of(&frame.a.radiance, &frame.b.radiance)
}

/// The picture that the correction is compared with: the full buffer's, else the mean of both.
pub fn denoised(frame: &Frame) -> Image {
    frame.denoised.clone().unwrap_or_else(|| Image::mean_of(&frame.a.denoised, &frame.b.denoised))
}

fn report(
    args: &FitArgs,
    settings: &Settings,
    input: &Input,
    prepared: &Prepared,
    fitted: &Fitted,
    result: &Outcome,
    seconds: Seconds,
) -> Report {
    let share = result.finished.share.data();
    Report {
        version: env!("CARGO_PKG_VERSION").into(),
        preset: args.preset,
        seed: args.seed,
        backend: args.backend.to_string(),
        instruction_set: Isa::best().name(),
        threads: rayon::current_num_threads(),
        width: prepared.width(),
        height: prepared.height(),
        exposure: prepared.exposure,
        composition: settings.composition,
        steps: fitted.history.len(),
        steps_dropped: fitted.dropped,
        end: fitted.end,
        rel_l2: result.rel_l2.clone(),
        loss: result.finished.loss,
        estimate: result.finished.estimate,
        fallback: result.finished.fallback.clone(),
        mean_share: share.iter().map(|&v| f64::from(v)).sum::<f64>() / share.len().max(1) as f64,
        seconds,
        milliseconds_per_step: 1e3 * fitted.seconds / fitted.history.len().max(1) as f64,
        peak_rss_bytes: peak_rss_bytes(),
        found: prepared.found,
        roles: input.frame.sources.iter().map(Into::into).collect(),
        skipped: skipped(prepared),
        warnings: input.frame.warnings.clone(),
        settings: settings_json(settings),
        history: fitted.history.clone(),
    }
}

fn say_what_was_read(progress: &Progress, inputs: &[Input], prepared: &[Prepared]) {
    for (input, prepared) in inputs.iter().zip(prepared) {
        progress.say(&format!("{}: {} x {} pixels", input.name, prepared.width(), prepared.height()));
        for s in &input.frame.sources {
            let channels = s.channels.join(",");
            progress.say(&format!("  {} of {} from {} [{channels}]", s.role, s.buffer, s.path.display()));
        }
        input.frame.warnings.iter().for_each(|warning| progress.say(&format!("  note: {warning}")));
        skipped(prepared).iter().for_each(|s| progress.say(&format!("  skipped: {} ({})", s.what, s.why)));
    }
}

fn say_result(progress: &Progress, input: &Input, result: &Outcome) {
    if let Some(reason) = &result.finished.fallback {
        progress.say(&format!("{}: the output is the denoiser's, {reason}", input.name));
    }
    let estimate = &result.finished.estimate;
    let error = estimate.corrected.standard_error.map_or("uncertainty unknown".into(), |e| format!("± {e:.5}"));
    progress.say(&format!(
        "estimated relL2 of the halves' mean: denoised {:.5}, corrected {:.5} {error}",
        estimate.denoised.value, estimate.corrected.value
    ));
    if let Some(RelL2 { noisy, denoised, corrected, .. }) = result.rel_l2 {
        progress.say(&format!(
            "relL2: noisy {noisy:.5}, denoised {denoised:.5}, corrected {corrected:.5} ({:.2} of the denoiser's)",
            corrected / denoised
        ));
    }
}
