//! `sspc-train fit`: read, prepare, train, correct, write.

use crate::cli::FitArgs;
use crate::error::Error;
use crate::experiment;
use crate::fit::{Control, Fitted, Limits, fit, starting_network};
use crate::inputs::{Input, frame_files, read, read_shot};
use crate::interrupt::interrupted;
use crate::output::OutputFolder;
use crate::preset::Settings;
use crate::progress::Progress;
use crate::report::{RelL2, Report, Seconds, peak_rss_bytes, settings_json};
use crate::write::{check_outputs, write_outputs};
use sspc_core::estimate::{Estimate, Losses};
use sspc_core::fill;
use sspc_core::finish::{Finish, Finished, unfilled_picture};
use sspc_core::native::run_rows;
use sspc_core::prepare::Prepared;
use sspc_frames::RoleOverrides;
use sspc_image::Image;
use sspc_kernels::gc::Taps;
use sspc_kernels::network::{Network, WindowNetwork};
use sspc_kernels::simd::Isa;
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
    let frames = match args.a {
        Some(_) => read_shot(args, &overrides, &settings)?,
        None => vec![read(frame_files(args)?, &overrides, &settings)?],
    };
    let (inputs, prepared): (Vec<Input>, Vec<Prepared>) = frames.into_iter().unzip();
    inputs.iter().for_each(|input| say_what_was_read(&progress, input));
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
        .zip(prepared)
        .map(|(input, prepared)| correct_frame(isa, args.strength, &settings, &fitted.network, input, prepared))
        .collect();
    let seconds = Seconds {
        read: read_seconds,
        train: fitted.seconds,
        correct: begin.elapsed().as_secs_f64(),
        ..Seconds::default()
    };
    let reports = inputs
        .iter()
        .zip(&results)
        .map(|(input, result)| report(args, &settings, input, &fitted, result, seconds))
        .collect();
    if interrupted() {
        return Err(Error::Interrupted);
    }
    write_outputs(args, &settings, &inputs, &fitted, &results, reports, folder, start)?;
    results.iter().zip(&inputs).for_each(|(result, input)| say_result(&progress, input, result));
    Ok(())
}

/// A corrected frame and what it says of itself.
pub struct Outcome {
    /// In the frame's units, `[3, H, W]`.
    pub corrected: Image,
    pub loss: Losses,
    pub estimate: Estimate,
    /// Why the output is the denoiser's everywhere, if it is.
    pub fallback: Option<String>,
    /// Mean share of the correction that was used, as local judgement and strength have it, 0..1.
    pub mean_share: f64,
    pub rel_l2: Option<RelL2>,
}

/// Corrects a frame, whose features are gone before the picture is made.
fn correct_frame(
    isa: Isa,
    strength: f32,
    settings: &Settings,
    network: &Network,
    input: &Input,
    prepared: Prepared,
) -> Outcome {
    let (taps, network) = (Taps::square(settings.radius), WindowNetwork::new(isa, settings.form, network));
    let parameters = |h: usize, rows| run_rows(&network, &prepared.halves[h], &prepared.plan, rows);
    let (form, composition) = (settings.form, settings.composition);
    let finished = Finish { isa, form, taps: &taps, composition, strength }.picture(&prepared, parameters);
    let (exposure, missing) = (prepared.exposure, prepared.valid.is_some());
    drop(prepared);
    let Finished { correction, share, mut halves, loss, estimate, fallback } = finished;
    let share = share.into_data();
    let mean_share = share.iter().map(|&v| f64::from(v)).sum::<f64>() / share.len().max(1) as f64;
    drop(share);
    let mut corrected = unfilled_picture(&input.denoised, exposure, &correction);
    drop(correction);
    if missing {
        fill::put(&mut corrected, &input.fill);
        fill::grow_shut(&mut corrected);
    }
    let rel_l2 = input.reference.as_ref().zip(input.rivals.as_ref()).map(|(reference, rivals)| {
        halves.data_mut().iter_mut().for_each(|v| *v /= exposure);
        RelL2::measure(&corrected, &halves, rivals, reference)
    });
    Outcome { corrected, loss, estimate, fallback, mean_share, rel_l2 }
}

fn report(
    args: &FitArgs,
    settings: &Settings,
    input: &Input,
    fitted: &Fitted,
    result: &Outcome,
    seconds: Seconds,
) -> Report {
    Report {
        version: env!("CARGO_PKG_VERSION").into(),
        preset: args.preset,
        seed: args.seed,
        backend: args.backend.to_string(),
        instruction_set: Isa::best().name(),
        threads: rayon::current_num_threads(),
        width: input.denoised.width(),
        height: input.denoised.height(),
        exposure: input.survey.exposure,
        composition: settings.composition,
        strength: args.strength,
        steps: fitted.history.len(),
        steps_dropped: fitted.dropped,
        end: fitted.end,
        rel_l2: result.rel_l2.clone(),
        loss: result.loss,
        estimate: result.estimate,
        fallback: result.fallback.clone(),
        mean_share: result.mean_share,
        seconds,
        milliseconds_per_step: 1e3 * fitted.seconds / fitted.history.len().max(1) as f64,
        peak_rss_bytes: peak_rss_bytes(),
        found: input.survey.found,
        roles: input.sources.iter().map(Into::into).collect(),
        skipped: input.skipped.clone(),
        warnings: input.warnings.clone(),
        settings: settings_json(settings),
        history: fitted.history.clone(),
    }
}

fn say_what_was_read(progress: &Progress, input: &Input) {
    progress.say(&format!("{}: {} x {} pixels", input.name, input.denoised.width(), input.denoised.height()));
    for s in &input.sources {
        let channels = s.channels.join(",");
        progress.say(&format!("  {} of {} from {} [{channels}]", s.role, s.buffer, s.path.display()));
    }
    input.warnings.iter().for_each(|warning| progress.say(&format!("  note: {warning}")));
    input.skipped.iter().for_each(|s| progress.say(&format!("  skipped: {} ({})", s.what, s.why)));
}

fn say_result(progress: &Progress, input: &Input, result: &Outcome) {
    if let Some(reason) = &result.fallback {
        progress.say(&format!("{}: the output is the denoiser's, {reason}", input.name));
    }
    let estimate = &result.estimate;
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
