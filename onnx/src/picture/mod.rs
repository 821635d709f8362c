//! The `picture` graph: from both halves to the picture that our programs write, in standard operators; and the
//! `operators` graph, the same with g_c by an operator of our own.

mod blend;
mod correct;
mod finish;
mod ops;
mod prepare;
mod tiles;
mod verdict;

use crate::apart::add_apart;
use crate::builder::Dim;
use crate::messages::GraphProto;
use crate::messages::data_type;
use crate::model::{Model, prefix};
use crate::network_graph::{encode, encode_with, planes};
use correct::Engine;
pub use correct::{DOMAIN, DOMAIN_VERSION, POST_CORRECTION, RADIUS_ATTRIBUTE};
use ops::Ops;
use prepare::Named;
use sspc_core::composition::Composition;
use verdict::Judged;

pub(crate) const PICTURE_GRAPH: &str = "sspc_picture";
pub(crate) const OPERATORS_GRAPH: &str = "sspc_operators";

/// The finished picture as an ONNX file: `sspc_core::correct`, but for what is decided about the halves before it.
///
/// Inputs: `radiance`, `denoised`, `albedo`, `normal` `[2, 3, H, W]`, `visibility` `[2, 1, H, W]` of half a and half b,
/// `denoised_full` `[1, 3, H, W]`, and `exposure` and `strength` `[1]`. Network k of several takes
/// `zK_denoised` and `zK_denoised_full` too, a model of shots `mean` and `mean_full`. Values may be NaN or infinite.
/// The halves count as equally many samples, whatever a frame says: means of both are plain.
/// Outputs: `picture` `[1, 3, H, W]` in the units of `denoised_full`, `share` `[1, 1, H, W]`, and `fallback` `[1]`: 0 where
/// the correction stays.
///
/// # Panics
/// When the weights do not fit the contract; [`Model::new`] checks that.
pub fn write_picture(model: &Model) -> Vec<u8> {
    encode(model, graph(model, Engine::Standard))
}

/// [`write_picture`] with g_c by [`POST_CORRECTION`], for onnxruntime with our operator library.
///
/// # Panics
/// As [`write_picture`].
pub fn write_operators(model: &Model) -> Vec<u8> {
    encode_with(model, graph(model, Engine::Operator), &[(DOMAIN, DOMAIN_VERSION)])
}

fn graph(model: &Model, engine: Engine) -> GraphProto {
    let judged = model.contract.composition == Composition::JudgedFullBuffer;
    let name = match engine {
        Engine::Standard => PICTURE_GRAPH,
        Engine::Operator => OPERATORS_GRAPH,
    };
    let mut g = Ops::new(name, "");
    prepare::prepare(&mut g, model);
    if engine == Engine::Standard {
        tiles::add_constants(&mut g, model.contract.window_radius as i64);
    }
    for k in 0..model.contract.networks {
        let shared = correct::shared(k);
        let shared: Vec<&str> = shared.iter().map(String::as_str).collect();
        add_apart(g.graph.graph_mut(), correct::of_network(model, k, engine), &prefix(k), &shared);
    }
    let halves = mean_over_networks(&mut g, model, correct::HALVES, Named::Z);
    let (halves, share, full, targets) = if judged {
        let full = mean_over_networks(&mut g, model, correct::FULL, Named::FULL_Z);
        let targets = blend::targets(&mut g);
        let (halves, full, share) = match model.contract.networks {
            1 => {
                let share = blend::share(&mut g, &halves, &targets);
                (halves, full, share)
            }
            _ => mean_or_first(&mut g, &halves, &full, &targets),
        };
        let [share, full] = blend::limited(&mut g, &halves, &full, &share);
        (halves, share, full, targets)
    } else {
        let none = g.times(Named::VALID, 0.0);
        let (share, full) = (g.add_to(&none, 1.0), g.reduce("ReduceMean", &halves, &[0]));
        (halves, share, full, String::new())
    };
    let share = g.mul(&share, "strength");
    let (away, used) = (g.sub(&full, Named::FULL_Z), g.mul(&share, Named::VALID));
    let correction = g.mul(&used, &away);
    let fallback = if judged {
        let judged = Judged { halves: &halves, targets: &targets, share: &share, correction: &correction };
        verdict::fallback(&mut g, &judged)
    } else {
        g.int(0)
    };
    let none = g.int(0);
    let kept = g.equal(&fallback, &none);
    let picture = finish::picture(&mut g, &correction, &kept);
    let nothing = g.float(0.0);
    let share = g.choose(&kept, &share, &nothing);
    let one = g.ints(&[1]);
    g.graph.op("Reshape", &[&fallback, &one], "fallback");
    g.graph.op("Identity", &[&picture], "picture");
    g.graph.op("Identity", &[&share], "share");
    let of = |channels: usize| {
        let [_, channels, height, width] = planes(channels);
        [Dim::Size(1), channels, height, width]
    };
    g.graph.output("picture", data_type::FLOAT, &of(3));
    g.graph.output("share", data_type::FLOAT, &of(1));
    g.graph.output("fallback", data_type::INT64, &[Dim::Size(1)]);
    g.finish()
}

/// The mean of what the networks give under a name, and z where nothing is computed.
fn mean_over_networks(g: &mut Ops, model: &Model, name: &str, z: &str) -> String {
    let networks = model.contract.networks;
    let mut sum = name.to_string();
    for k in 1..networks {
        sum = g.add(&sum, &format!("{}{name}", prefix(k)));
    }
    let mean = if networks > 1 { g.times(&sum, 1.0 / networks as f32) } else { sum };
    g.choose(Named::ACTIVE, &mean, z)
}

/// Halves and full buffer of the mean over the networks, or of the first where that is judged better, and their share.
fn mean_or_first(g: &mut Ops, halves: &str, full: &str, targets: &str) -> (String, String, String) {
    let first = g.choose(Named::ACTIVE, correct::HALVES, Named::Z);
    let first_full = g.choose(Named::ACTIVE, correct::FULL, Named::FULL_Z);
    let [share, weight] = blend::choice(g, &first, halves, targets);
    (g.mix(&first, halves, &weight), g.mix(&first_full, full, &weight), share)
}
