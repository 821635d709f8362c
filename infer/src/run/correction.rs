//! From a frame's rows to its corrected picture and passes: whole where memory holds it, else in bands.

use super::shared::Shared;
use sspc_cli::passes::{CorrectedPasses, FramePasses};
use sspc_cli::reading::Source;
use sspc_cli::{Code, Failure, interrupt};
use sspc_core::bands::{FrameBands, PreparedFrame};
use sspc_core::correct::{CorrectError, Corrected, CorrectionSettings, correct, is_one_band};
use sspc_core::frame_stats::FrameStats;
use sspc_core::passes::SplitError;
use sspc_frames::OutputPlan;
use sspc_image::Frame;
use std::time::Instant;

/// What came of a frame.
pub struct Corrections {
    pub corrected: Corrected,
    pub passes: Option<CorrectedPasses>,
    /// What a person should know; said already.
    pub notes: Vec<String>,
}

/// Corrects a frame called `name`, and its passes so that they add up to the picture as `output` keeps it.
///
/// # Errors
/// What reading rows and running the network can raise; interruption.
pub fn correct_source(
    shared: &Shared,
    name: &str,
    source: Source,
    stats: FrameStats,
    passes: Option<FramePasses>,
    output: &OutputPlan,
) -> Result<Corrections, Failure> {
    let Shared { arguments, engine, isa, .. } = *shared;
    let contract = &engine.model().contract;
    let how = contract.correction(isa, arguments.run.strength);
    let how = CorrectionSettings { keep_maps: arguments.report, ..how };
    let source = match source {
        Source::Held(frame)
            if passes.is_none()
                && contract.differences == 0.0
                && is_one_band(frame.height(), frame.width(), contract.networks) =>
        {
            let corrected = whole(shared, *frame, stats, &how)?;
            return Ok(Corrections { corrected, passes: None, notes: Vec::new() });
        }
        source => source,
    };
    let (mut bands, mut notes) =
        (FrameBands::new(&source, stats, contract.composition.skips_still_blocks()), Vec::new());
    if contract.differences > 0.0 {
        (bands, notes) = bands.with_differences(contract.differences)?;
    }
    notes.iter().for_each(|note| shared.output.say(&format!("{name}: note: {note}")));
    let corrected = correct(&mut bands, engine, &how, &interrupt::asked).map_err(|error| match error {
        CorrectError::Interrupted => Failure::interrupted(),
        CorrectError::Parameters(error) => network_failed(&error),
        CorrectError::Bands(error) => error.into(),
    })?;
    let with_picture = |passes: FramePasses| {
        passes.correct(&mut bands, engine, &how, &output.as_stored(0, &corrected.picture), &interrupt::asked)
    };
    let passes = passes.map(with_picture).transpose().map_err(|error| match error {
        SplitError::Interrupted => Failure::interrupted(),
        SplitError::Parameters(error) => network_failed(&error),
        SplitError::Bands(error) | SplitError::Passes(error) => error.into(),
    })?;
    Ok(Corrections { corrected, passes, notes })
}

/// A frame that is not needed afterwards: each half goes as soon as its features are there.
fn whole(shared: &Shared, frame: Frame, stats: FrameStats, how: &CorrectionSettings) -> Result<Corrected, Failure> {
    let begin = Instant::now();
    let how = CorrectionSettings { rows: Some(frame.height()), ..*how };
    let composition = shared.engine.model().contract.composition;
    let mut frame = PreparedFrame::of_owned(frame, stats, composition.skips_still_blocks());
    let features = begin.elapsed().as_secs_f64();
    let mut corrected = correct(&mut frame, shared.engine, &how, &interrupt::asked).map_err(|error| match error {
        CorrectError::Interrupted => Failure::interrupted(),
        CorrectError::Parameters(error) => network_failed(&error),
        CorrectError::Bands(never) => match never {},
    })?;
    corrected.seconds.features += features;
    Ok(corrected)
}

fn network_failed(error: &impl std::fmt::Display) -> Failure {
    Failure::new(Code::Run, error.to_string(), "try --kernels fused")
}
