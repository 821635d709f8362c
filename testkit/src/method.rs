//! The way from a frame in memory to its picture, as both programs go it.

use sspc_core::bands::FrameBands;
use sspc_core::composition::Composition;
use sspc_core::correct::{Corrected, CorrectionSettings};
use sspc_core::frame_stats::FrameStats;
use sspc_core::plan::Plan;
use sspc_core::rng::Rng;
use sspc_core::tiles::{self, ParameterSource};
use sspc_image::{Frame, Image};
use sspc_kernels::network::{Network, Shape, WindowNetwork};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_onnx::Contract;
use std::fmt::Debug;

/// Activated parameters `[P, H, W]` of a picture's features `[13, H, W]`, where the plan computes anything.
///
/// # Panics
/// When the source fails.
pub fn planned<S: ParameterSource>(source: &S, features: &Image, plan: &Plan) -> Image
where
    S::Error: Debug,
{
    tiles::parameters(source, 0, features, plan, 0..features.height()).expect("parameters")
}

/// The same of every pixel.
///
/// # Panics
/// When the source fails.
pub fn parameters<S: ParameterSource>(source: &S, features: &Image) -> Image
where
    S::Error: Debug,
{
    planned(source, features, &Plan::everything(features.height(), features.width()))
}

/// A network of ours, whose outputs are the parameters of `form`, on the widest instruction set.
pub fn window_network(form: Form, network: &Network) -> WindowNetwork {
    WindowNetwork::new(Isa::best(), form, network)
}

/// A small network of random weights, whose outputs are the parameters of `form`.
pub fn random_network(form: Form, seed: u64) -> WindowNetwork {
    let shape = Shape { hidden: 4, layers: 2, outputs: form.parameters() };
    let mut rng = Rng::new(seed);
    let weights = (0..shape.parameter_count()).map(|_| rng.uniform() * 0.4 - 0.2).collect();
    window_network(form, &Network { shape, weights })
}

/// A correction as a model's contract asks for it, at full strength, in bands as large as fit.
pub fn settings(contract: &Contract) -> CorrectionSettings {
    settings_of(contract.form, contract.window_radius, contract.composition)
}

/// The same by what of a contract it needs.
pub fn settings_of(form: Form, window_radius: usize, composition: Composition) -> CorrectionSettings {
    CorrectionSettings {
        isa: Isa::best(),
        form,
        window_radius,
        composition,
        strength: 1.0,
        rows: None,
        judged_by_held_out: false,
        keep_maps: true,
    }
}

/// Corrects a frame.
///
/// # Panics
/// When the source fails.
pub fn correct<S: ParameterSource + ?Sized>(
    frame: &Frame,
    stats: FrameStats,
    source: &S,
    how: &CorrectionSettings,
) -> Corrected
where
    S::Error: Debug,
{
    let skips = how.composition == Composition::JudgedFullBuffer;
    let mut bands = FrameBands::new(frame, stats, skips);
    sspc_core::correct::correct(&mut bands, source, how, &|| false).expect("a picture")
}
