//! What every model file states: form, sizes, conventions and origin.

use sspc_core::composition::Composition;
use sspc_core::correct::CorrectionSettings;
use sspc_core::prepare::Exposure;
use sspc_kernels::features::{FeatureSet, MAX_RADIUS};
use sspc_kernels::gc::PAPER_RADIUS;
use sspc_kernels::network::{MAX_CHANNELS, Shape};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use std::collections::BTreeMap;

/// The version of this contract. It is raised by any change that would make an older reader compute another picture:
/// channel order, activations, exposure rule, window, meaning of an output.
pub const CONTRACT_VERSION: u32 = 1;

/// The version of a contract of several networks; with one, it is [`CONTRACT_VERSION`].
pub const SEVERAL_NETWORKS_VERSION: u32 = 2;
/// The version of a contract whose z is a temporal mean over neighbouring frames, with any number of networks.
pub const SHOT_VERSION: u32 = 3;
/// The version of a contract whose correction is judged by differences of y too, with any number of networks and frames.
pub const DIFFERENCES_VERSION: u32 = 4;
/// Most neighbouring frames on each side.
pub const MAX_EXTRA_FRAMES: usize = 4;
/// Most networks that the reader accepts.
pub const MAX_NETWORKS: usize = 8;
/// Most convolutions that the reader accepts: far more than are useful.
pub const MAX_LAYERS: usize = 32;
/// Largest sizes that the kernels support.
pub(crate) const MAX_HIDDEN: usize = MAX_CHANNELS;
/// Heaviest that differences may weigh.
pub(crate) const MAX_DIFFERENCES: f32 = 100.0;
pub(crate) const MAX_WINDOW_RADIUS: usize = MAX_RADIUS;

/// What the graphs apply to the last convolution's outputs o.
pub const ACTIVATIONS: &str =
    "beta: tanh(o); gamma: 1/(softplus(o)^2 + 1e-4); tau: softplus(o) + 1e-4; gate: 1/(1 + exp(-o))";

/// How borders of the picture are treated.
pub const PADDING: &str = "network: zeros, same size; window of g_c: mirrored with the edge pixel repeated";

/// How values become features, and what is done to the result.
pub fn exposure_rule(exposure: Exposure) -> &'static str {
    match exposure {
        Exposure::AsIs => {
            "scale 1; y clamped at -10 and z at 0; albedo, visibility and normal as rendered; absent or \
constant features 0"
        }
        Exposure::Normalised => {
            "scale 0.25 / mean of the darker 95 % of the positive z of both halves (mean of both \
halves and of the three channels, finite pixels); y and z of both halves times the scale, y \
clamped at -10 and z at 0; the picture divided by the scale; albedo, visibility and normal as rendered; absent or \
constant features 0"
        }
        Exposure::OfNoise => {
            "scale 0.25 / mean of the darker 95 % of the positive z of both halves (mean of both \
halves and of the three channels, finite pixels) over pixels with noise; noise is the mean over the \
three channels of the difference of both halves' y, at most z, and counts from 1 % of the value \
that half of the sum of all noise exceeds; y and z of both halves times the scale, y clamped at \
-10 and z at 0; the picture divided by the scale; albedo, visibility and normal as rendered; absent or constant \
features 0"
        }
    }
}

/// The same in models from before noisy radiance was left as it is where it is negative. They are read: of radiance that is
/// nowhere negative both rules make the same.
pub(crate) fn earlier_exposure_rule(exposure: Exposure) -> String {
    let rule = exposure_rule(exposure);
    rule.replace("1; y clamped at -10 and z at 0", "1; y and z clamped at 0")
        .replace("y clamped at -10 and z at 0", "clamped at 0")
}

/// The form's name in a file's metadata.
pub fn form_name(form: Form) -> &'static str {
    match form {
        Form::Paper => "paper",
        Form::Gated => "gated",
    }
}

/// The form of a model and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Contract {
    /// Paper or gated.
    pub form: Form,
    /// Size of the network; its outputs are the form's parameters.
    pub shape: Shape,
    /// How many networks of that size there are: one for each denoised picture of a half, in their order.
    pub networks: usize,
    /// Neighbouring frames on each side whose warped mean stands in the place of z; 0 where z is the frame's own.
    pub extra_frames: usize,
    /// How heavily differences of y weigh, beside what their noise deserves, in what the correction is judged by; 0: not.
    pub differences: f32,
    /// Radius of the square window of g_c, pixels.
    pub window_radius: usize,
    /// How our own programs compose the picture; the image graph returns the mean of the halves.
    pub composition: Composition,
    /// How radiance was brought to the method's scale in training.
    pub exposure: Exposure,
    /// Seed of the fit.
    pub seed: u64,
    /// Training frames as the user named them.
    pub frames: Vec<String>,
    /// Program and version that fitted the model.
    pub tool: String,
    /// Preset of the fit.
    pub preset: String,
    /// Optimiser steps taken.
    pub steps: u64,
    /// Optional features of the training frames; absent ones were zero.
    pub features: FeatureSet,
    /// Further entries; keys of letters, digits, `.`, `_` and `-`.
    pub extra: BTreeMap<String, String>,
}

impl Contract {
    /// A contract of the paper's network and window, normalised exposure, all features and the form's usual
    /// composition, of unknown origin.
    pub fn new(form: Form) -> Self {
        Contract {
            form,
            shape: Shape::paper(form),
            networks: 1,
            extra_frames: 0,
            differences: 0.0,
            window_radius: PAPER_RADIUS,
            composition: match form {
                Form::Paper => Composition::MeanOfHalves,
                Form::Gated => Composition::JudgedFullBuffer,
            },
            exposure: Exposure::Normalised,
            seed: 0,
            frames: Vec::new(),
            tool: String::new(),
            preset: String::new(),
            steps: 0,
            features: FeatureSet::ALL,
            extra: BTreeMap::new(),
        }
    }

    /// The version that states it.
    pub fn version(&self) -> u32 {
        if self.differences > 0.0 {
            return DIFFERENCES_VERSION;
        }
        match (self.extra_frames, self.networks) {
            (0, 1) => CONTRACT_VERSION,
            (0, _) => SEVERAL_NETWORKS_VERSION,
            _ => SHOT_VERSION,
        }
    }

    /// How a frame is corrected with a model of this contract, `strength` 0..1 of its correction.
    pub fn correction(&self, isa: Isa, strength: f32) -> CorrectionSettings {
        CorrectionSettings {
            isa,
            form: self.form,
            window_radius: self.window_radius,
            composition: self.composition,
            strength,
            rows: None,
            judged_by_held_out: false,
            keep_maps: false,
        }
    }
}
