//! Both halves corrected by one network, with their own guides and with those of the full buffer.
//!
//! g_c is made of standard operators, or of our own ([`Engine`]).

use super::ops::Ops;
use super::prepare::{Named, denoised_of};
use super::tiles::{BIAS, CHUNK_ROWS, GROUPS, NEVER, ONES, Pairs, TILE, VALUES, Values, window_sums};
use crate::builder::{int, ints};
use crate::messages::GraphProto;
use crate::model::Model;
use crate::network_graph::activated_parts;
use sspc_core::composition::Composition;
use sspc_kernels::gc::WEIGHT_FLOOR;
use sspc_kernels::parameters::Form;

/// What a network's graph gives: the halves' corrections `[2, 3, H, W]` and, for the picture, their mean with the guides
/// of the full buffer, `[1, 3, H, W]`.
pub(super) const HALVES: &str = "halves";
pub(super) const FULL: &str = "full";

/// Domain, version and name of our own operator, which `sspc-onnx-extension` adds to onnxruntime: g_c (Eqs. 10, 11) of
/// features `[N, 13, H, W]`, activated parameters `[N, P, H, W]` and the mask of valid pixels `[1, 1, H, W]`, in a window
/// of an attribute's radius; `[N, 3, H, W]`, z where it is not finite.
pub const DOMAIN: &str = "sspc";
/// See [`DOMAIN`].
pub const DOMAIN_VERSION: i64 = 1;
/// See [`DOMAIN`].
pub const POST_CORRECTION: &str = "PostCorrection";
/// See [`DOMAIN`].
pub const RADIUS_ATTRIBUTE: &str = "window_radius";

/// The values that network `k` takes from the graph around it.
pub(super) fn shared(k: usize) -> Vec<String> {
    let [own, full] = denoised_of(k);
    Named::ALL.into_iter().chain([ONES, BIAS]).map(String::from).chain([own, full]).collect()
}

/// What g_c is computed by.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Engine {
    /// Standard operators.
    Standard,
    /// [`POST_CORRECTION`].
    Operator,
}

/// The graph of network `k`: from the values of [`shared`] to [`HALVES`] and [`FULL`].
pub(super) fn of_network(model: &Model, k: usize, engine: Engine) -> GraphProto {
    let mut g = Ops::new("network", "net_");
    let [own_z, full_z] = denoised_of(k);
    let features = g.concat(&[Named::Y, Named::RHO, Named::V, Named::N, &own_z], 1);
    let parts = activated_parts(&mut g.graph, model, k, &features);
    match engine {
        Engine::Standard => standard(&mut g, model, &features, &full_z, &parts),
        Engine::Operator => by_operator(&mut g, model, &features, &full_z, &parts),
    }
    g.finish()
}

/// [`HALVES`] and [`FULL`] by our own operator.
fn by_operator(g: &mut Ops, model: &Model, features: &str, full_z: &str, parts: &[String]) {
    let parts: Vec<&str> = parts.iter().map(String::as_str).collect();
    let parameters = g.concat(&parts, 1);
    let radius = vec![int(RADIUS_ATTRIBUTE, model.contract.window_radius as i64)];
    let corrected = |g: &mut Ops, features: &str, output: &str| {
        let inputs = [features, &parameters, Named::VALID];
        g.graph.op_of(DOMAIN, POST_CORRECTION, &inputs, output, radius.clone())
    };
    corrected(g, features, HALVES);
    if model.contract.composition == Composition::JudgedFullBuffer {
        let full = g.concat(&[Named::FULL_RHO, Named::FULL_V, Named::FULL_N, full_z], 1);
        let full = g.concat(&[&full, &full], 0);
        let of_full = g.concat(&[Named::Y, &full], 1);
        let both = corrected(g, &of_full, "full_halves");
        g.graph.op_with("ReduceMean", &[&both], FULL, vec![ints("axes", &[0]), int("keepdims", 1)]);
    }
}

/// [`HALVES`] and [`FULL`] in standard operators.
fn standard(g: &mut Ops, model: &Model, features: &str, full_z: &str, parts: &[String]) {
    let gated = model.contract.form == Form::Gated;
    let radius = model.contract.window_radius as i64;
    let (height, width) = (g.size(Named::Y, 2), g.size(Named::Y, 3));
    let padded = [g.round_up(&height, CHUNK_ROWS), g.round_up(&width, TILE)];
    let parts: Vec<String> = parts.iter().map(|part| g.pad_to(part, &padded[0], &padded[1])).collect();
    let valid = g.pad_to(Named::VALID, &padded[0], &padded[1]);

    let missing = g.add_to(Named::VALID, -1.0);
    let penalty = g.times(&missing, -NEVER);
    let both = g.concat(&[&penalty, &penalty], 0);
    let mut of_guides = vec![g.concat(&[features, &both], 1)];
    if model.contract.composition == Composition::JudgedFullBuffer {
        let full = g.concat(&[Named::FULL_RHO, Named::FULL_V, Named::FULL_N, full_z, &penalty], 1);
        let full = g.concat(&[&full, &full], 0);
        of_guides.push(g.concat(&[Named::Y, &full], 1));
    }
    let rows = mirrored(g, &height, &padded[0], radius);
    let columns = mirrored(g, &width, &padded[1], radius);
    let values: Vec<(Values, Centre)> = of_guides
        .iter()
        .map(|values| {
            let wide = g.gather(values, &rows, 2);
            let keys = g.gather(&wide, &columns, 3);
            relative(g, keys, &padded, radius)
        })
        .collect();
    let (values, centres): (Vec<Values>, Vec<Centre>) = values.into_iter().unzip();
    let pairs = Pairs { guides: &values, gamma: &parts[1], height: &padded[0], width: &padded[1], radius };
    let sums = window_sums(g, &pairs);
    let tau = g.mul(&parts[2], &valid);
    for (i, output) in [HALVES, FULL].into_iter().enumerate().take(values.len()) {
        let estimate = combine(g, &sums[i], &values[i].pixels, &centres[i].least, &parts[0], &tau);
        let z = &centres[i].z;
        let estimate = if gated { g.mix(z, &estimate, &parts[3]) } else { estimate };
        let finite = g.is_finite(&estimate);
        let finite = g.channels("ReduceMin", &finite);
        let kept = g.choose(&finite, &estimate, z);
        let cropped = g.crop(&kept, &height, &width);
        match output {
            FULL => g.graph.op_with("ReduceMean", &[&cropped], FULL, vec![ints("axes", &[0]), int("keepdims", 1)]),
            _ => g.graph.op("Identity", &[&cropped], HALVES),
        };
    }
}

/// The pixels of a padded picture.
struct Centre {
    /// The least of its tile for every pixel, `[2, 13, H, W]`.
    least: String,
    /// `[2, 3, H, W]`.
    z: String,
}

/// Keys, and the pixels among them relative to the least of their tile.
fn relative(g: &mut Ops, keys: String, padded: &[String; 2], radius: i64) -> (Values, Centre) {
    let (start, size) = (g.ints(&[radius; 2]), g.concat(&[&padded[0], &padded[1]], 0));
    let end = g.add(&start, &size);
    let inside = g.slice(&keys, &start, &end, &[2, 3]);
    let x = g.split(&inside, &[VALUES - 1, 1], 1).swap_remove(0);
    let z = g.split(&x, &GROUPS, 1).swap_remove(2);
    let negative = g.neg(&x);
    let pooled = g.pool_max(&negative, [TILE, TILE]);
    let least = g.neg(&pooled);
    let of_pixels = g.enlarge(&least, [TILE, TILE], &padded[0], &padded[1]);
    let pixels = g.sub(&x, &of_pixels);
    (Values { keys, pixels, least }, Centre { least: of_pixels, z })
}

/// For each row or column of a padded picture with a radius around it the pixel that it shows: mirrored at the borders
/// with the edge pixel repeated, as often as a small picture needs.
fn mirrored(g: &mut Ops, size: &str, padded: &str, radius: i64) -> String {
    let (two, radii) = (g.int(2), g.int(2 * radius));
    let (period, length) = (g.mul(size, &two), g.add(padded, &radii));
    let count = g.range_of(&length, 1, &[-1]);
    // A multiple of the period keeps the dividend from being negative.
    let (lift, radius) = (g.int(radius), g.int(radius));
    let lift = g.mul(&period, &lift);
    let shift = g.sub(&lift, &radius);
    let lifted = g.add(&count, &shift);
    let forward = g.modulo(&lifted, &period);
    let one = g.int(1);
    let turn = g.sub(&period, &one);
    let backward = g.sub(&turn, &forward);
    g.min(&forward, &backward)
}

/// g_c (Eq. 10) from sums relative to the tile's least x_0: the slopes' terms do not depend on it, and
/// Σ w y_i = Σ w (y_i - y_0) + y_0 Σ w.
fn combine(g: &mut Ops, sums: &str, pixels: &str, least: &str, slopes: &str, tau: &str) -> String {
    let sums = g.split(sums, &[3, 3, 1, 3, 3, 1], 1);
    let pixels = g.split(pixels, &[3, 3, 1, 3, 3], 1);
    let least = g.split(least, &[3, 10], 1).swap_remove(0);
    let slopes = g.split(slopes, &[3; 3], 1);
    let weight_of_taps = &sums[5];
    let weight = g.add(weight_of_taps, tau);
    let (own, base) = (g.mul(tau, &pixels[0]), g.mul(&least, &weight));
    let of_y = g.add(&sums[0], &own);
    let mut numerator = g.add(&of_y, &base);
    for (slope, group) in [(0, 4), (1, 1), (2, 3)] {
        let centre = g.mul(&pixels[group], weight_of_taps);
        let gradient = g.sub(&centre, &sums[group]);
        let sloped = g.mul(&slopes[slope], &gradient);
        numerator = g.add(&numerator, &sloped);
    }
    let floor = g.float(WEIGHT_FLOOR);
    let divisor = g.max(&weight, &floor);
    g.div(&numerator, &divisor)
}
