//! What every model file promises, and what it says of its origin.

use crate::model::Shape;
use std::collections::BTreeMap;

/// The version of this contract. It changes with anything that would make an older reader compute
/// another picture: channel order, activations, exposure rule, window, meaning of an output.
pub const CONTRACT_VERSION: u32 = 1;

/// The 13 input channels of the network, in order: y, rho, v, n, z.
pub const INPUT_CHANNELS: [&str; 13] = [
    "y.r", "y.g", "y.b", "rho.r", "rho.g", "rho.b", "v", "n.x", "n.y", "n.z", "z.r", "z.g", "z.b",
];

/// The output channels of the gated form; the paper's form is its first 15.
const OUTPUT_CHANNELS: [&str; 16] = [
    "beta_z.r", "beta_z.g", "beta_z.b", "beta_rho.r", "beta_rho.g", "beta_rho.b", "beta_n.x",
    "beta_n.y", "beta_n.z", "gamma_rho", "gamma_n", "gamma_v", "gamma_y", "gamma_z", "tau", "gate",
];

/// Radius of the window of g_c, pixels: 19x19.
pub const WINDOW_RADIUS: usize = 9;

/// What the graphs apply to the last convolution's outputs o.
pub const ACTIVATIONS: &str =
    "beta: tanh(o); gamma: 1/(softplus(o)^2 + 1e-4); tau: softplus(o) + 1e-4; gate: 1/(1 + exp(-o))";

/// How image borders are treated.
pub const PADDING: &str =
    "network: zeros, same size; window of g_c: mirrored with the edge pixel repeated";

/// What is done to values before they become features.
pub const EXPOSURE_RULE: &str = "y and z of both halves times one scale, then clamped at 0; \
the picture divided by that scale; albedo, visibility and normal as rendered; absent features 0";

/// Which combination the parameters are for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// 15 parameters: mu = g_c (Back et al. 2022, Eq. 10).
    Paper,
    /// 16 parameters: mu = z + s (g_c - z), s the gate in 0..1.
    Gated,
}

impl Form {
    /// Number of parameter channels P.
    pub fn parameters(self) -> usize {
        match self {
            Form::Paper => 15,
            Form::Gated => 16,
        }
    }

    /// The name in the file's metadata.
    pub fn name(self) -> &'static str {
        match self {
            Form::Paper => "paper",
            Form::Gated => "gated",
        }
    }

    /// Names of the parameter channels, in order.
    pub fn output_channels(self) -> &'static [&'static str] {
        &OUTPUT_CHANNELS[..self.parameters()]
    }
}

/// Which optional features the training frames had; an absent one was fed as zeros.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Features {
    pub albedo: bool,
    pub normal: bool,
    pub visibility: bool,
}

impl Features {
    pub const ALL: Features = Features { albedo: true, normal: true, visibility: true };
}

/// The form of a model and where it comes from.
#[derive(Clone, Debug, PartialEq)]
pub struct Contract {
    pub form: Form,
    /// Size of the network.
    pub shape: Shape,
    /// Radius of the window of g_c, pixels; only [`WINDOW_RADIUS`] is read by this version.
    pub window_radius: usize,
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
    pub features: Features,
    /// Anything else worth keeping; keys of letters, digits, `.`, `_` and `-`.
    pub extra: BTreeMap<String, String>,
}

impl Contract {
    /// A contract of the paper's network size with nothing known of its origin.
    pub fn new(form: Form) -> Self {
        Contract {
            form,
            shape: Shape::PAPER,
            window_radius: WINDOW_RADIUS,
            seed: 0,
            frames: Vec::new(),
            tool: String::new(),
            preset: String::new(),
            steps: 0,
            features: Features::ALL,
            extra: BTreeMap::new(),
        }
    }
}
