//! From a frame and a model to the picture.

use crate::frame::GivenFrame;
use crate::report::PictureReport;
use crate::watch::Watch;
use sspc_cli::reading::{InspectedFrame, check_variants};
use sspc_cli::{Code, Failure};
use sspc_core::bands::FrameBands;
use sspc_core::correct::{CorrectError, Corrected, CorrectionSettings, correct};
use sspc_core::tiles::ParameterSource;
use sspc_image::Image;
use sspc_kernels::network::{Shape, WindowNetwork};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_onnx::Model;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Shares of the time that have gone by before the first window of the network and after the last, about: 0.1 s and 3.3 s of
/// 4.4 s, measured with 1280 x 720 pixels and a model of 19 x 19 windows.
const WINDOWS: [f64; 2] = [0.05, 0.75];

/// A corrected picture and what it says of itself.
pub struct CorrectedFrame {
    /// The picture, with [`Corrected::maps`] where they were asked for.
    pub corrected: Corrected,
    /// Every figure.
    pub report: PictureReport,
}

/// Corrects a frame with a fitted model, as `sspc-infer run` does: the same pixels, bit for bit. A frame of a shot is taken
/// by itself, and so it is without files' neighbours there.
///
/// # Errors
/// A strength outside of 0..1, a frame that cannot be used or does not suit the model, interruption by `watch`.
///
/// # Panics
/// As [`GivenFrame::inspect`].
pub fn correct_frame(
    frame: GivenFrame,
    model: &Model,
    strength: f32,
    keep_maps: bool,
    watch: &Watch,
) -> Result<CorrectedFrame, Failure> {
    let isa = Isa::from_env()?;
    if !(0.0..=1.0).contains(&strength) {
        return Err(Failure::new(Code::Arguments, format!("strength {strength}: expected a number from 0 to 1"), ""));
    }
    watch.tell(0.0);
    let contract = &model.contract;
    let InspectedFrame { frame, stats, mut warnings, .. } = frame.inspect(contract.exposure)?;
    check_variants(contract.networks, frame.variants.len().max(1))?;
    if contract.extra_frames > 0 {
        warnings.push("the model was fitted with neighbouring frames; a frame by itself has none".to_string());
    }
    let stats = stats.with_features_of(contract.features);
    let bands = FrameBands::new(&frame, stats, contract.composition.skips_still_blocks());
    let (mut bands, said) = match contract.differences > 0.0 {
        true => bands.with_differences(contract.differences).unwrap_or_else(|never| match never {}),
        false => (bands, Vec::new()),
    };
    warnings.extend(said);
    let how = CorrectionSettings { keep_maps, ..contract.correction(isa, strength) };
    let networks: Vec<_> = model.networks().iter().map(|n| WindowNetwork::new(isa, contract.form, n)).collect();
    let pixels = 2 * networks.len() * frame.height() * frame.width();
    let networks = WatchedNetworks { networks: &networks, watch, pixels, done: AtomicUsize::new(0) };
    watch.tell(WINDOWS[0]);
    let corrected = correct(&mut bands, &networks, &how, &|| watch.stops()).map_err(|error| match error {
        CorrectError::Interrupted | CorrectError::Parameters(Stopped) => Failure::interrupted(),
        CorrectError::Bands(never) => match never {},
    })?;
    // By then the last window's answer is there.
    watch.tell(0.99);
    if watch.stops() {
        return Err(Failure::interrupted());
    }
    let report = PictureReport::new(isa, contract.composition, strength, &stats, warnings, &corrected);
    watch.tell(1.0);
    Ok(CorrectedFrame { corrected, report })
}

/// Networks that tell of each window, and end when they are asked to.
struct WatchedNetworks<'a> {
    networks: &'a [WindowNetwork],
    watch: &'a Watch<'a>,
    /// Of both halves' windows of every network; bands overlap, and still blocks are passed over.
    pixels: usize,
    done: AtomicUsize,
}

/// The watch stopped the work.
struct Stopped;

impl ParameterSource for WatchedNetworks<'_> {
    type Error = Stopped;

    fn shape(&self) -> Shape {
        self.networks.shape()
    }

    fn networks(&self) -> usize {
        self.networks.networks()
    }

    fn window(&self, k: usize, features: Image, wanted: Region) -> Result<Image, Stopped> {
        if self.watch.stops() {
            return Err(Stopped);
        }
        let Ok(parameters) = self.networks.window(k, features, wanted);
        let done = self.done.fetch_add(wanted.pixels(), Ordering::Relaxed) + wanted.pixels();
        let share = (done as f64 / self.pixels as f64).min(1.0);
        self.watch.tell(WINDOWS[0] + (WINDOWS[1] - WINDOWS[0]) * share);
        Ok(parameters)
    }
}
