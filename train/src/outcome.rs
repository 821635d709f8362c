//! A fitted model's picture of a frame, and what the frame says of it.

use crate::inputs::Input;
use crate::preset::Settings;
use crate::report::RelL2;
use sspc_cli::passes::{CorrectedPasses, FramePasses};
use sspc_cli::{Failure, interrupt};
use sspc_core::bands::PreparedFrame;
use sspc_core::correct::{CorrectError, CorrectionSettings, correct};
use sspc_core::frame_sums::Verdict;
use sspc_core::passes::SplitError;
use sspc_core::prepare::Prepared;
use sspc_image::Image;
use sspc_kernels::network::{Network, WindowNetwork};
use sspc_kernels::simd::Isa;

/// A corrected frame and what it says of itself.
pub struct Outcome {
    /// In the frame's units, `[3, H, W]`.
    pub corrected: Image,
    /// Additive passes, where they were asked for.
    pub passes: Option<CorrectedPasses>,
    /// The judgement of the whole.
    pub verdict: Verdict,
    /// Mean share of the correction that was used, as weights and strength have it, 0..1.
    pub mean_share: f64,
    /// Mean weight of each network's correction; their sum is 1.
    pub network_weights: Vec<f64>,
    /// Mean share of the composite of passes in the correction, where there is one.
    pub composite_share: Option<f64>,
    /// Share of the correction that was used, 0..1, `[1, H, W]`, where it was asked for.
    pub share: Option<Image>,
    /// Against the reference, where there is one.
    pub rel_l2: Option<RelL2>,
}

impl Outcome {
    /// The corrected picture and the passes, in the order of the frame's output.
    pub fn pictures(&self) -> impl Iterator<Item = &Image> {
        [&self.corrected].into_iter().chain(self.passes.iter().flat_map(|passes| &passes.pictures))
    }
}

/// Corrects a frame, whose features are gone before the picture is made; `keeps_share`: for [`Outcome::share`].
///
/// # Errors
/// When it is interrupted.
pub fn correct_frame(
    isa: Isa,
    strength: f32,
    keeps_share: bool,
    settings: &Settings,
    networks: &[Network],
    input: &mut Input,
    prepared: Prepared,
) -> Result<Outcome, Failure> {
    let how = CorrectionSettings {
        isa,
        form: settings.form,
        window_radius: settings.radius,
        composition: settings.composition,
        strength,
        rows: Some(prepared.height()),
        judged_by_held_out: settings.leaves_pixels_out(prepared.height(), prepared.width()),
        keep_maps: keeps_share || input.reference.is_some(),
    };
    let networks: Vec<_> = networks.iter().map(|n| WindowNetwork::new(isa, settings.form, n)).collect();
    let passes = input.passes.take();
    let frame = PreparedFrame::new(prepared, input.stats, &input.denoised, &input.fill);
    let mut frame = frame.that_stays(passes.is_some());
    let corrected = correct(&mut frame, &networks[..], &how, &interrupt::asked).map_err(|error| match error {
        CorrectError::Interrupted => Failure::interrupted(),
        CorrectError::Bands(never) | CorrectError::Parameters(never) => match never {},
    })?;
    let with_picture = |passes: FramePasses| {
        let stored = input.output.as_stored(0, &corrected.picture);
        passes.correct(&mut frame, &networks[..], &how, &stored, &interrupt::asked)
    };
    let passes = passes.map(with_picture).transpose().map_err(|error| match error {
        SplitError::Interrupted => Failure::interrupted(),
        SplitError::Passes(error) => error.into(),
        SplitError::Bands(never) | SplitError::Parameters(never) => match never {},
    })?;
    let rivals = input.reference.as_ref().zip(input.rivals.as_ref());
    let rel_l2 = rivals.map(|(reference, rivals)| {
        let fell_back = corrected.verdict.fallback.is_some();
        let halves = corrected.maps.as_ref().filter(|_| !fell_back).map(|maps| &maps.halves);
        RelL2::measure(&corrected.picture, halves, rivals, reference)
    });
    let share = corrected.maps.filter(|_| keeps_share).map(|maps| maps.share);
    Ok(Outcome {
        corrected: corrected.picture,
        passes,
        verdict: corrected.verdict,
        mean_share: corrected.mean_share,
        network_weights: corrected.network_weights,
        composite_share: corrected.composite_share,
        share,
        rel_l2,
    })
}
