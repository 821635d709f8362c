//! From the inputs to the method's units: what `sspc_core::prepare` and `sspc_core::plan` do.

use super::ops::Ops;
use crate::builder::{Dim, int, ints};
use crate::messages::data_type;
use crate::model::{Model, prefix};
use crate::network_graph::planes;
use sspc_core::composition::Composition;
use sspc_core::plan::{BLOCK_COLUMNS, BLOCK_ROWS};
use sspc_core::prepare::LEAST_RADIANCE;
use sspc_image::Role;

/// The largest radiance of the method, and the largest feature: squares must not overflow.
const LARGEST_COLOUR: f32 = 1e15;
const LARGEST_FEATURE: f32 = 1e4;

/// Names of values that several stages take, in the method's units; 0 at missing pixels.
pub(super) struct Named;

impl Named {
    pub const Y: &str = "y";
    pub const RHO: &str = "rho";
    pub const V: &str = "v";
    pub const N: &str = "n";
    /// Of the full buffer.
    pub const FULL_RHO: &str = "full_rho";
    pub const FULL_V: &str = "full_v";
    pub const FULL_N: &str = "full_n";
    /// 1 where a pixel counts, 0 where it is missing, `[1, 1, H, W]`.
    pub const VALID: &str = "valid";
    /// z of the frame itself, `[2, 3, H, W]`, and of its full buffer.
    pub const Z: &str = "z";
    pub const FULL_Z: &str = "full_z";
    /// Whether a pixel's block is computed, `[1, 1, H, W]` or one value for all.
    pub const ACTIVE: &str = "active";
    /// What networks take.
    pub const ALL: [&str; 8] =
        [Self::Y, Self::RHO, Self::V, Self::N, Self::FULL_RHO, Self::FULL_V, Self::FULL_N, Self::VALID];
}

/// z that network `k` is given, of the halves and of the full buffer.
pub(super) fn denoised_of(k: usize) -> [String; 2] {
    [format!("z_of_network_{k}"), format!("full_z_of_network_{k}")]
}

/// Inputs of what network `k` is given in the place of z, of the halves and of the full buffer; none where that is z.
pub(super) fn inputs_of(model: &Model, k: usize) -> Option<[String; 2]> {
    let name = |end: &str| format!("{}{end}", prefix(k));
    match (model.contract.extra_frames, k) {
        (0, 0) => None,
        (0, _) => Some([name("denoised"), name("denoised_full")]),
        _ => Some([name("mean"), name("mean_full")]),
    }
}

/// Adds the inputs and everything of [`Named`].
pub(super) fn prepare(g: &mut Ops, model: &Model) {
    declare(g, model);
    let colours = [Role::Radiance.name(), Role::Denoised.name(), "denoised_full"];
    let finite: Vec<String> = colours.iter().map(|colour| finite_everywhere(g, colour)).collect();
    let both = g.mul(&finite[0], &finite[1]);
    g.graph.op("Mul", &[&both, &finite[2]], Named::VALID);
    let is_valid = g.is_set(Named::VALID);
    let least = [LEAST_RADIANCE, 0.0, 0.0];
    for ((input, name), least) in colours.into_iter().zip([Named::Y, Named::Z, Named::FULL_Z]).zip(least) {
        let scaled = colour(g, input, &is_valid, least);
        g.graph.op("Identity", &[&scaled], name);
    }
    let fitted = model.contract.features;
    for (role, name, full, fitted) in [
        (Role::Albedo, Named::RHO, Named::FULL_RHO, fitted.albedo),
        (Role::Visibility, Named::V, Named::FULL_V, fitted.visibility),
        (Role::Normal, Named::N, Named::FULL_N, fitted.normal),
    ] {
        let value = feature(g, role.name(), &is_valid, fitted);
        g.graph.op("Identity", &[&value], name);
        g.graph.op_with("ReduceMean", &[name], full, vec![ints("axes", &[0]), int("keepdims", 1)]);
    }
    for k in 0..model.contract.networks {
        let given = inputs_of(model, k);
        for (i, (name, ground)) in denoised_of(k).iter().zip([Named::Z, Named::FULL_Z]).enumerate() {
            let value = match &given {
                None => ground.to_string(),
                Some(inputs) => {
                    let finite = g.is_finite(&inputs[i]);
                    let finite = g.channels("ReduceMin", &finite);
                    let own = colour(g, &inputs[i], &is_valid, 0.0);
                    g.choose(&finite, &own, ground)
                }
            };
            g.graph.op("Identity", &[&value], name);
        }
    }
    active(g, model.contract.composition);
}

fn declare(g: &mut Ops, model: &Model) {
    let of = |images: usize, channels: usize| {
        let [_, channels, height, width] = planes(channels);
        [Dim::Size(images), channels, height, width]
    };
    for role in [Role::Radiance, Role::Denoised, Role::Albedo, Role::Visibility, Role::Normal] {
        g.graph.input(role.name(), data_type::FLOAT, &of(2, role.channels()));
    }
    g.graph.input("denoised_full", data_type::FLOAT, &of(1, 3));
    for [halves, full] in (0..model.contract.networks).filter_map(|k| inputs_of(model, k)) {
        g.graph.input(&halves, data_type::FLOAT, &of(2, 3));
        g.graph.input(&full, data_type::FLOAT, &of(1, 3));
    }
    for name in ["exposure", "strength"] {
        g.graph.input(name, data_type::FLOAT, &[Dim::Size(1)]);
    }
}

/// 1 where all channels of all images are finite, `[1, 1, H, W]`.
fn finite_everywhere(g: &mut Ops, images: &str) -> String {
    let finite = g.is_finite(images);
    let number = g.as_float(&finite);
    let of_each = g.reduce("ReduceMin", &number, &[1]);
    g.reduce("ReduceMin", &of_each, &[0])
}

/// Scaled and no less than `least`, 0 at missing pixels.
fn colour(g: &mut Ops, picture: &str, is_valid: &str, least: f32) -> String {
    let scaled = g.mul(picture, "exposure");
    let clamped = g.clip(&scaled, least, LARGEST_COLOUR);
    let nothing = g.float(0.0);
    g.choose(is_valid, &clamped, &nothing)
}

/// 0 where the feature is not finite in both halves, and everywhere where it was not trained with or has one value.
fn feature(g: &mut Ops, images: &str, is_valid: &str, fitted: bool) -> String {
    let present = finite_everywhere(g, images);
    let present = g.is_set(&present);
    let counts = g.and(&present, is_valid);
    let clamped = g.clip(images, -LARGEST_FEATURE, LARGEST_FEATURE);
    let nothing = g.float(0.0);
    let value = g.choose(&counts, &clamped, &nothing);
    if !fitted {
        return g.times(&value, 0.0);
    }
    let finite = g.is_finite(images);
    let looked_at = g.and(&finite, is_valid);
    let mut extreme = |operator: &str, neutral: f32| {
        let neutral = g.float(neutral);
        let values = g.choose(&looked_at, images, &neutral);
        g.reduce(operator, &values, &[0, 2, 3])
    };
    let (most, least) = (extreme("ReduceMax", f32::MIN), extreme("ReduceMin", f32::MAX));
    let varies = g.greater(&most, &least);
    let varies = g.channels("ReduceMax", &varies);
    let varies = g.as_float(&varies);
    g.mul(&value, &varies)
}

/// Blocks with noise, or, for the mean of halves, all of a picture that has any.
fn active(g: &mut Ops, composition: Composition) {
    let (a, b) = (g.at(Named::Y, 0, 0), g.at(Named::Y, 1, 0));
    let equal = g.equal(&a, &b);
    let differs = g.not(&equal);
    let differs = g.channels("ReduceMax", &differs);
    let noise = g.as_float(&differs);
    let noise = g.mul(&noise, Named::VALID);
    let half = g.float(0.5);
    if !composition.skips_still_blocks() {
        let any = g.reduce("ReduceMax", &noise, &[0, 1, 2, 3]);
        g.graph.op("Greater", &[&any, &half], Named::ACTIVE);
        return;
    }
    let block = [BLOCK_ROWS as i64, BLOCK_COLUMNS as i64];
    let (height, width) = (g.size(&noise, 2), g.size(&noise, 3));
    let (rows, columns) = (g.round_up(&height, block[0]), g.round_up(&width, block[1]));
    let padded = g.pad_to(&noise, &rows, &columns);
    let blocks = g.pool_max(&padded, block);
    let of_pixels = g.enlarge(&blocks, block, &height, &width);
    g.graph.op("Greater", &[&of_pixels, &half], Named::ACTIVE);
}
