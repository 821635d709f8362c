//! The correction added to the denoiser's picture, and missing pixels filled: what `sspc_core::correct` and
//! `sspc_core::fill` do.

use super::ops::Ops;
use crate::builder::{Dim, int, ints, subgraph};
use crate::messages::{GraphProto, data_type};

/// The denoiser's picture with a correction in the method's units; `kept` says whether it stays at all.
pub(super) fn picture(g: &mut Ops, correction: &str, kept: &str) -> String {
    let (nothing, z) = (g.float(0.0), "denoised_full");
    let inverse = g.op("Reciprocal", &["exposure"]);
    let step = g.mul(correction, &inverse);
    let sum = g.add(z, &step);
    let corrected = g.relu(&sum);
    // Out-of-gamut colours stay the denoiser's.
    let negative = g.less(z, &nothing);
    let unchanged = g.equal(correction, &nothing);
    let stays = g.or(&negative, &unchanged);
    let moves = g.not(&stays);
    let moves = g.and(&moves, kept);
    let picture = g.choose(&moves, &corrected, z);
    filled(g, &picture)
}

/// Pixels that are not finite take the first value that is, of the halves' denoised pictures and then of their radiance,
/// and else grow shut.
fn filled(g: &mut Ops, picture: &str) -> String {
    let sources: Vec<String> =
        ["radiance", "denoised"].iter().flat_map(|of| [1, 0].map(|half| g.at(of, half, 0))).collect();
    // The first choice is applied last.
    let mut value = sources[0].clone();
    for source in &sources[1..] {
        let finite = finite_pixels(g, source);
        value = g.choose(&finite, source, &value);
    }
    let finite = finite_pixels(g, picture);
    let picture = g.choose(&finite, picture, &value);
    let (finite, nothing) = (finite_pixels(g, &picture), g.float(0.0));
    let number = g.as_float(&finite);
    let zeroed = g.choose(&finite, &picture, &nothing);
    let start = g.concat(&[&zeroed, &number], 1);
    let most = {
        let (height, width) = (g.size(&picture, 2), g.size(&picture, 3));
        let most = g.max(&height, &width);
        let none = g.ints(&[]);
        g.reshape(&most, &none)
    };
    let missing = any_missing(g, &number);
    let grown = g.several("Loop", &[&most, &missing, &start], 1, vec![subgraph("body", ring())]);
    g.split(&grown[0], &[3, 1], 1).swap_remove(0)
}

/// One ring of missing pixels: the mean of the neighbours that have a value. Colours, and a plane that is 1 where they
/// have one.
fn ring() -> GraphProto {
    let mut g = Ops::new("ring", "ring_");
    g.graph.input("ring_trip", data_type::INT64, &[]);
    g.graph.input("ring_condition", data_type::BOOL, &[]);
    g.graph.input("ring_picture", data_type::FLOAT, &[Dim::Free; 4]);
    let old = g.split("ring_picture", &[3, 1], 1);
    // Zeros outside count as pixels of the mean, so that all four planes are divided alike.
    let with = |pads: [i64; 4], kernel: [i64; 2]| {
        vec![ints("kernel_shape", &kernel), ints("pads", &pads), int("count_include_pad", 1)]
    };
    let rows = g.op_with("AveragePool", &["ring_picture"], with([0, 1, 0, 1], [1, 3]));
    let around = g.op_with("AveragePool", &[&rows], with([1, 0, 1, 0], [3, 1]));
    let parts = g.split(&around, &[3, 1], 1);
    let least = g.float(0.01);
    let has_neighbour = g.greater(&parts[1], &least);
    let mean = g.div(&parts[0], &parts[1]);
    let nothing = g.float(0.0);
    let mean = g.choose(&has_neighbour, &mean, &nothing);
    let has_value = g.is_set(&old[1]);
    let colours = g.choose(&has_value, &old[0], &mean);
    let now = g.or(&has_value, &has_neighbour);
    let number = g.as_float(&now);
    g.graph.op_with("Concat", &[&colours, &number], "ring_grown", vec![int("axis", 1)]);
    let missing = any_missing(&mut g, &number);
    g.graph.op("Identity", &[&missing], "ring_again");
    g.graph.output("ring_again", data_type::BOOL, &[]);
    g.graph.output("ring_grown", data_type::FLOAT, &[Dim::Free; 4]);
    g.finish()
}

fn any_missing(g: &mut Ops, number: &str) -> String {
    let least = g.reduce("ReduceMin", number, &[0, 1, 2, 3]);
    let none = g.ints(&[]);
    let least = g.reshape(&least, &none);
    let there = g.is_set(&least);
    g.not(&there)
}

/// Pixels of which all channels are finite, `[1, 1, H, W]`.
fn finite_pixels(g: &mut Ops, picture: &str) -> String {
    let finite = g.is_finite(picture);
    g.channels("ReduceMin", &finite)
}
