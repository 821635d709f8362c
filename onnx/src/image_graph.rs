//! The `image` graph: the plain mean of both corrected halves in standard operators, for other engines.

use crate::apart::add_apart;
use crate::builder::{Dim, GraphBuilder, int, ints};
use crate::messages::data_type;
use crate::model::{Model, prefix};
use crate::network_graph::{activated_parts, encode, planes};
use crate::window_sum::add_window_sums;
use sspc_image::Role;
use sspc_kernels::gc::WEIGHT_FLOOR;
use sspc_kernels::parameters::Form;

pub(crate) const IMAGE_GRAPH: &str = "sspc_image";

/// The corrector as an ONNX file. N is the number of half buffers (2, or 1 to see one half alone).
///
/// Inputs: `radiance`, `denoised`, `albedo`, `normal` `[N, 3, H, W]`, `visibility` `[N, 1, H, W]`,
/// `exposure` `[1]`. Outputs: `corrected` `[1, 3, H, W]` = max(0, mean over the halves), and
/// `halves` `[N, 3, H, W]`, both in the units of `radiance`. Values must be finite. Of several networks, each takes its
/// own denoised picture, `denoised`, `z2_denoised` and so on, and the halves are the mean over the networks.
///
/// # Panics
/// When the weights do not fit the contract; [`Model::new`] checks that.
pub fn write_image(model: &Model) -> Vec<u8> {
    let networks = model.contract.networks;
    let mut graph = match networks {
        1 => halves_graph(model, 0, "halves"),
        _ => mean_of_networks(model),
    };
    let mean = vec![ints("axes", &[0]), int("keepdims", 1)];
    graph.op_with("ReduceMean", &["halves"], "mean_of_halves", mean);
    graph.op("Relu", &["mean_of_halves"], "corrected");
    let [_, channels, height, width] = planes(3);
    graph.output("corrected", data_type::FLOAT, &[Dim::Size(1), channels, height, width]);
    graph.output("halves", data_type::FLOAT, &planes(3));
    encode(model, graph.finish())
}

/// Inputs that all networks take alike.
const SHARED: [&str; 5] = ["radiance", "albedo", "visibility", "normal", "exposure"];

/// Both halves corrected by each network, and their mean: `halves` `[N, 3, H, W]`.
fn mean_of_networks(model: &Model) -> GraphBuilder {
    let networks = model.contract.networks;
    let mut graph = halves_graph(model, 0, "own_halves");
    for k in 1..networks {
        add_apart(graph.graph_mut(), halves_graph(model, k, "own_halves").finish(), &prefix(k), &SHARED);
    }
    let mut sum = String::from("own_halves");
    for k in 1..networks {
        sum = graph.op("Add", &[&sum, &format!("{}own_halves", prefix(k))], &format!("sum_of_{}", k + 1));
    }
    graph.floats("networks", &[], &[networks as f32]);
    graph.op("Div", &[&sum, "networks"], "halves");
    graph
}

/// Both halves corrected by network `k`: `halves` `[N, 3, H, W]`.
fn halves_graph(model: &Model, k: usize, halves: &str) -> GraphBuilder {
    let mut graph = GraphBuilder::new(IMAGE_GRAPH);
    declare(&mut graph);
    let features = features(&mut graph);
    let parameters = activated_parts(&mut graph, model, k, &features);
    split_parameters(&mut graph, &parameters);
    add_window_sums(&mut graph, model.contract.window_radius);
    let mut estimate = combine(&mut graph);
    if model.contract.form == Form::Gated {
        let residual = graph.op("Sub", &[&estimate, "z"], "residual");
        let gated = graph.op("Mul", &["gate", &residual], "gated_residual");
        estimate = graph.op("Add", &["z", &gated], "gated_estimate");
    }
    graph.op("Div", &[&estimate, "exposure"], halves);
    graph
}

fn declare(graph: &mut GraphBuilder) {
    for role in [Role::Radiance, Role::Denoised, Role::Albedo, Role::Visibility, Role::Normal] {
        graph.input(role.name(), data_type::FLOAT, &planes(role.channels()));
    }
    graph.input("exposure", data_type::FLOAT, &[Dim::Size(1)]);
}

/// Adds `y`, `z`, `rho`, `v` and `n` in normalised exposure and the network's input.
fn features(graph: &mut GraphBuilder) -> String {
    for (input, scaled, name) in [("radiance", "scaled_y", "y"), ("denoised", "scaled_z", "z")] {
        graph.op("Mul", &[input, "exposure"], scaled);
        graph.op("Relu", &[scaled], name);
    }
    for (input, name) in [("albedo", "rho"), ("visibility", "v"), ("normal", "n")] {
        graph.op("Identity", &[input], name);
    }
    graph.op_with("Concat", &["y", "rho", "v", "n", "z"], "features", vec![int("axis", 1)])
}

/// Splits beta and gamma into the parts used by the sums.
fn split_parameters(graph: &mut GraphBuilder, parameters: &[String]) {
    graph.ints("slope_groups", &[3], &[3, 3, 3]);
    let slopes = ["beta_z", "beta_rho", "beta_n"];
    graph.node("Split", &[&parameters[0], "slope_groups"], &slopes, vec![int("axis", 1)]);
    graph.op("Neg", &[&parameters[1]], "minus_gamma");
    graph.ints("bandwidth_groups", &[5], &[1; 5]);
    let bandwidths = ["minus_gamma_rho", "minus_gamma_n", "minus_gamma_v", "minus_gamma_y", "minus_gamma_z"];
    graph.node("Split", &["minus_gamma", "bandwidth_groups"], &bandwidths, vec![int("axis", 1)]);
}

/// g_c (Eq. 10) from the window's sums. The slopes belong to the centre pixel, so
/// sum w (y_i + beta (x_c - x_i)) = sum w y_i + beta (x_c sum w - sum w x_i).
fn combine(graph: &mut GraphBuilder) -> String {
    let mut numerator = String::from("y_sum");
    for (value, slope) in [("z", "beta_z"), ("rho", "beta_rho"), ("n", "beta_n")] {
        let name = |part: &str| format!("{value}_{part}");
        let centre = graph.op("Mul", &[value, "weight_sum"], &name("centre"));
        let difference = graph.op("Sub", &[&centre, &name("sum")], &name("gradient"));
        let sloped = graph.op("Mul", &[slope, &difference], &name("sloped"));
        numerator = graph.op("Add", &[&numerator, &sloped], &name("numerator"));
    }
    graph.floats("weight_floor", &[], &[WEIGHT_FLOOR]);
    let divisor = graph.op("Max", &["weight_sum", "weight_floor"], "weight_divisor");
    graph.op("Div", &[&numerator, &divisor], "estimate")
}
