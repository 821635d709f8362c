//! `info`: what a model file says of itself, in words.

use clap::Args;
use sspc_cli::output::print_result;
use sspc_cli::{Code, Failure};
use sspc_core::composition::Composition;
use sspc_core::frame_stats::Exposure;
use sspc_kernels::features::{CHANNEL_NAMES, FeatureSet};
use sspc_kernels::parameters::Form;
use sspc_onnx::{ACTIVATIONS, GraphKind, Model, PADDING, exposure_rule, load_model_and_kind};
use std::path::PathBuf;

/// The arguments of `info`.
#[derive(Clone, Debug, Args)]
pub struct InfoArguments {
    /// A model that sspc-train wrote
    #[arg(value_name = "model.onnx")]
    pub model: PathBuf,
}

/// Runs the subcommand.
///
/// # Errors
/// A [`Failure`] of code 3 when the file is no model.
pub fn run(arguments: &InfoArguments) -> Result<(), Failure> {
    let (model, kind) = load_model_and_kind(&arguments.model).map_err(|error| {
        Failure::new(Code::Input, error.to_string(), "give a model.onnx that sspc-train fit or export wrote")
    })?;
    let text = describe(&model, kind);
    print_result(&text)
}

fn describe(model: &Model, kind: GraphKind) -> String {
    let c = &model.contract;
    let mut lines = vec![
        ("graph", graph_words(kind)),
        ("contract", format!("version {}", c.version())),
        ("form", form_words(c.form).into()),
        ("picture", picture_words(c.composition).into()),
        (
            "network",
            format!(
                "{}{} convolutions 3x3, {} hidden channels, {} weights ({} kB)",
                if c.networks > 1 { format!("{}, one for each denoised picture: ", c.networks) } else { String::new() },
                c.shape.layers,
                c.shape.hidden,
                model.weights.len(),
                model.weights.len() * 4 / 1000
            ),
        ),
        ("inputs", CHANNEL_NAMES.join(", ")),
        ("parameters", c.form.parameter_names().join(", ")),
        ("activations", ACTIVATIONS.into()),
        ("borders", PADDING.into()),
        ("window", format!("{0}x{0} pixels, radius {1}", 2 * c.window_radius + 1, c.window_radius)),
        ("exposure", format!("{}: {}", exposure_name(c.exposure), exposure_rule(c.exposure))),
        ("features", feature_words(c.features)),
        ("fitted on", or_unknown(&c.frames.join(", "))),
        ("fitted by", or_unknown(&c.tool)),
        ("preset", format!("{}, {} steps, seed {}", or_unknown(&c.preset), c.steps, c.seed)),
    ];
    if c.differences > 0.0 {
        lines.push(("differences", format!("dx and dy judge too, {} times what their noise deserves", c.differences)));
    }
    let extra: Vec<(&str, String)> = c.extra.iter().map(|(k, v)| (k.as_str(), v.clone())).collect();
    lines.extend(extra);
    lines.iter().map(|(key, value)| format!("{key:<12} {}\n", printable(value))).collect()
}

/// Text from a file may hold anything; a terminal should not see its control characters.
fn printable(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).collect()
}

fn or_unknown(text: &str) -> String {
    if text.is_empty() { "not recorded".into() } else { text.into() }
}

fn graph_words(kind: GraphKind) -> String {
    match kind {
        GraphKind::Network => "network: features [N, 13, H, W] to parameters [N, P, H, W]".into(),
        GraphKind::Image => "image: the half buffers to the mean of both corrected, in standard operators".into(),
        GraphKind::Picture => "picture: the half buffers to the finished picture, in standard operators".into(),
        GraphKind::Operators => "operators: the half buffers to the finished picture, by libsspc_operators".into(),
    }
}

fn form_words(form: Form) -> &'static str {
    match form {
        Form::Paper => "paper: g_c, 15 parameters a pixel",
        Form::Gated => "gated: z + s (g_c - z), 16 parameters a pixel",
    }
}

fn picture_words(composition: Composition) -> &'static str {
    match composition {
        Composition::MeanOfHalves => "mean of both corrected halves",
        Composition::JudgedFullBuffer => {
            "the full buffer's correction, kept where the halves' judgement of each other allows"
        }
    }
}

fn exposure_name(exposure: Exposure) -> &'static str {
    match exposure {
        Exposure::AsIs => "as is",
        Exposure::Normalised => "normalised",
        Exposure::OfNoise => "of noise",
    }
}

fn feature_words(set: FeatureSet) -> String {
    if set == FeatureSet::NONE { "none".into() } else { set.names(", ") }
}
