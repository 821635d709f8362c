//! The `network` graph: features -> activated parameters.

use crate::apart::add_apart;
use crate::builder::{Dim, GraphBuilder, int, ints};
use crate::messages::{GraphProto, ModelProto, OperatorSetIdProto, data_type};
use crate::metadata;
use crate::model::{Model, layer_name, prefix};
use prost::Message;
use sspc_kernels::features::FEATURE_CHANNELS;
use sspc_kernels::parameters::{ACTIVATION_FLOOR, BANDWIDTH_COUNT, Form, SLOPE_COUNT};

pub(crate) const NETWORK_GRAPH: &str = "sspc_network";
/// All operators used are in opset 17, which engines since 2022 read.
const OPSET: i64 = 17;
const IR_VERSION: i64 = 8;

/// The network as an ONNX file: `features` `[N, 13, H, W]` -> `parameters` `[N, P, H, W]`, with N, H
/// and W free. The parameters are activated, ready for g_c. Further networks have inputs and outputs of their own,
/// `z2_features` -> `z2_parameters` and so on.
///
/// # Panics
/// When the weights do not fit the contract; [`Model::new`] checks that.
pub fn write_network(model: &Model) -> Vec<u8> {
    let mut graph = network_graph(model, 0);
    for k in 1..model.contract.networks {
        add_apart(&mut graph, network_graph(model, k), &prefix(k), &[]);
    }
    encode(model, graph)
}

fn network_graph(model: &Model, k: usize) -> GraphProto {
    let form = model.contract.form;
    let mut graph = GraphBuilder::new(NETWORK_GRAPH);
    graph.input("features", data_type::FLOAT, &planes(FEATURE_CHANNELS));
    graph.output("parameters", data_type::FLOAT, &planes(form.parameters()));
    let parts = activated_parts(&mut graph, model, k, "features");
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    graph.op_with("Concat", &parts, "parameters", vec![int("axis", 1)]);
    graph.finish()
}

/// `[N, channels, H, W]` with N, H and W free.
pub(crate) fn planes(channels: usize) -> [Dim; 4] {
    [Dim::Named("N"), Dim::Size(channels), Dim::Named("H"), Dim::Named("W")]
}

/// Adds the convolutions of network `k` and activations; returns the names of beta `[N, 9, H, W]`, gamma
/// `[N, 5, H, W]`, tau `[N, 1, H, W]` and, in the gated form, gate `[N, 1, H, W]`.
pub(crate) fn activated_parts(graph: &mut GraphBuilder, model: &Model, k: usize, features: &str) -> Vec<String> {
    let raw = convolutions(graph, model, k, features);
    let gated = model.contract.form == Form::Gated;
    let mut raw_parts = vec!["raw_beta", "raw_gamma", "raw_tau"];
    let mut sizes = vec![SLOPE_COUNT as i64, BANDWIDTH_COUNT as i64, 1];
    if gated {
        raw_parts.push("raw_gate");
        sizes.push(1);
    }
    graph.ints("parameter_groups", &[sizes.len()], &sizes);
    graph.node("Split", &[&raw, "parameter_groups"], &raw_parts, vec![int("axis", 1)]);
    graph.floats("activation_floor", &[], &[ACTIVATION_FLOOR as f32]);

    let beta = graph.op("Tanh", &["raw_beta"], "beta");
    let root = softplus(graph, "raw_gamma", "gamma_root");
    let square = graph.op("Mul", &[&root, &root], "gamma_square");
    let floored = graph.op("Add", &[&square, "activation_floor"], "gamma_floored");
    let gamma = graph.op("Reciprocal", &[&floored], "gamma");
    let root = softplus(graph, "raw_tau", "tau_root");
    let tau = graph.op("Add", &[&root, "activation_floor"], "tau");
    let mut parts = vec![beta, gamma, tau];
    if gated {
        parts.push(graph.op("Sigmoid", &["raw_gate"], "gate"));
    }
    parts
}

/// softplus(x) = max(x, 0) + log(1 + exp(-|x|)): the textbook form log(1 + exp(x)), which some
/// engines use for the Softplus operator, overflows beyond 88.
fn softplus(graph: &mut GraphBuilder, x: &str, output: &str) -> String {
    let one = format!("{output}_one");
    graph.floats(&one, &[], &[1.0]);
    let magnitude = graph.op("Abs", &[x], &format!("{output}_abs"));
    let negated = graph.op("Neg", &[&magnitude], &format!("{output}_neg"));
    let exponential = graph.op("Exp", &[&negated], &format!("{output}_exp"));
    let sum = graph.op("Add", &[&exponential, &one], &format!("{output}_sum"));
    let log = graph.op("Log", &[&sum], &format!("{output}_log"));
    let positive = graph.op("Relu", &[x], &format!("{output}_positive"));
    graph.op("Add", &[&positive, &log], output)
}

fn convolutions(graph: &mut GraphBuilder, model: &Model, k: usize, features: &str) -> String {
    let shape = model.contract.shape;
    let mut value = features.to_string();
    for l in 0..shape.layers {
        let name = layer_name(l);
        let (inputs, outputs) = shape.channels(l);
        let (weight, bias) = model.layer(k, l);
        let weight = graph.floats(&format!("{name}.weight"), &[outputs, inputs, 3, 3], weight);
        let bias = graph.floats(&format!("{name}.bias"), &[outputs], bias);
        let attributes = vec![ints("kernel_shape", &[3, 3]), ints("pads", &[1, 1, 1, 1])];
        value = graph.op_with("Conv", &[&value, &weight, &bias], &name, attributes);
        if l + 1 < shape.layers {
            value = graph.op("Relu", &[&value], &format!("relu{l}"));
        }
    }
    value
}

/// Wraps a graph with versions and the contract's metadata.
pub(crate) fn encode(model: &Model, graph: GraphProto) -> Vec<u8> {
    encode_with(model, graph, &[])
}

/// The same, of a graph with operators of further domains, each with its version.
pub(crate) fn encode_with(model: &Model, graph: GraphProto, domains: &[(&str, i64)]) -> Vec<u8> {
    ModelProto {
        ir_version: Some(IR_VERSION),
        producer_name: Some("sspc".into()),
        producer_version: Some(env!("CARGO_PKG_VERSION").into()),
        doc_string: Some("Self-supervised post-correction of a denoised Monte Carlo render".into()),
        graph: Some(graph),
        opset_import: [("", OPSET)].iter().chain(domains).map(operator_set).collect(),
        metadata_props: metadata::write(&model.contract),
    }
    .encode_to_vec()
}

fn operator_set(&(domain, version): &(&str, i64)) -> OperatorSetIdProto {
    OperatorSetIdProto { domain: Some(domain.into()), version: Some(version) }
}
