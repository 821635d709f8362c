//! The whole network over a batch of tiles: forward with saved activations, backward, and a
//! memory-bounded forward over a picture of any size.

use super::conv::{Finish, Packed, convolve, weight_gradient};
use super::planes::{Geometry, Planes};
use super::{MAX_CHANNELS, Network, Shape, layer};
use crate::features::FEATURE_CHANNELS;
use crate::image::Image;
use crate::simd::Isa;
use rayon::prelude::*;

/// What the backward pass needs of a forward pass: each tile's input of every layer.
pub struct Activations {
    geometry: Geometry,
    tiles: Vec<Vec<Planes>>,
}

fn packed_layers(isa: Isa, shape: &Shape, weights: &[f32]) -> Vec<Packed> {
    (0..shape.layers)
        .map(|l| {
            let (kernel, bias) = layer(shape, weights, l);
            Packed::forward(isa, shape.channels(l).0, kernel, bias)
        })
        .collect()
}

fn finish_of(shape: &Shape, l: usize) -> Finish<'static> {
    if l + 1 == shape.layers { Finish::Linear } else { Finish::Relu }
}

/// Network outputs before activation, `[batch, outputs, height, width]`, of features
/// `[batch, 13, height, width]`, and the activations for [`backward`].
///
/// # Panics
/// When a slice does not have the length that shape, batch and size demand.
pub fn forward(
    isa: Isa,
    shape: &Shape,
    weights: &[f32],
    features: &[f32],
    height: usize,
    width: usize,
) -> (Vec<f32>, Activations) {
    assert_eq!(weights.len(), shape.parameter_count(), "flat weights");
    let pixels = height * width;
    assert_eq!(features.len() % (FEATURE_CHANNELS * pixels), 0, "whole tiles of features");
    let geometry = Geometry::new(height, width);
    let packed = packed_layers(isa, shape, weights);
    let batch = features.len() / (FEATURE_CHANNELS * pixels);
    let mut outputs = vec![0.0; batch * shape.outputs * pixels];
    let tiles = outputs
        .par_chunks_mut(shape.outputs * pixels)
        .zip(features.par_chunks(FEATURE_CHANNELS * pixels))
        .map(|(out, tile)| {
            let mut inputs = vec![Planes::from_planar(geometry, FEATURE_CHANNELS, tile)];
            for (l, packed) in packed.iter().enumerate() {
                let mut next = Planes::zeros(geometry, MAX_CHANNELS);
                convolve(isa, &inputs[l], packed, finish_of(shape, l), &mut next);
                inputs.push(next);
            }
            if let Some(last) = inputs.pop() {
                last.copy_to(out);
            }
            inputs
        })
        .collect();
    (outputs, Activations { geometry, tiles })
}

/// Gradient of the flat weights, given the gradient of [`forward`]'s outputs. Tiles are summed in
/// their order, whatever the number of threads.
pub fn backward(isa: Isa, shape: &Shape, weights: &[f32], saved: &Activations, upstream: &[f32]) -> Vec<f32> {
    let pixels = saved.geometry.height * saved.geometry.width;
    assert_eq!(upstream.len(), saved.tiles.len() * shape.outputs * pixels, "upstream gradient");
    let transposed: Vec<Packed> = (1..shape.layers)
        .map(|l| {
            let (inputs, outputs) = shape.channels(l);
            Packed::transposed(isa, inputs, outputs, layer(shape, weights, l).0)
        })
        .collect();
    let per_tile: Vec<Vec<f32>> = saved
        .tiles
        .par_iter()
        .zip(upstream.par_chunks(shape.outputs * pixels))
        .map(|(inputs, upstream)| tile_gradient(isa, shape, saved.geometry, &transposed, inputs, upstream))
        .collect();
    let mut total = vec![0.0; shape.parameter_count()];
    for gradient in &per_tile {
        for (t, g) in total.iter_mut().zip(gradient) {
            *t += g;
        }
    }
    total
}

fn tile_gradient(
    isa: Isa,
    shape: &Shape,
    geometry: Geometry,
    transposed: &[Packed],
    inputs: &[Planes],
    upstream: &[f32],
) -> Vec<f32> {
    let mut gradient = vec![0.0; shape.parameter_count()];
    let mut current = Planes::zeros(geometry, MAX_CHANNELS);
    current.fill(upstream);
    let mut next = Planes::zeros(geometry, MAX_CHANNELS);
    for l in (0..shape.layers).rev() {
        let (inputs_of_layer, outputs) = shape.channels(l);
        let start = shape.layer_start(l);
        let slot = &mut gradient[start..start + shape.layer_len(l)];
        weight_gradient(isa, &inputs[l], inputs_of_layer, &current, outputs, slot);
        if l > 0 {
            convolve(isa, &current, &transposed[l - 1], Finish::MaskedBy(&inputs[l]), &mut next);
            std::mem::swap(&mut current, &mut next);
        }
    }
    gradient
}

/// Side of the windows that [`run`] works in, without their halo.
const RUN_TILE: usize = 96;

/// Network outputs before activation for a whole picture, `[outputs, H, W]`, of features
/// `[13, H, W]`. Works in windows with a halo of the network's radius; at the picture's border the
/// zero padding of every layer is exact, so the tiling does not show.
pub fn run(isa: Isa, network: &Network, features: &Image) -> Image {
    let (height, width) = (features.height(), features.width());
    let shape = &network.shape;
    let packed = packed_layers(isa, shape, &network.weights);
    let windows: Vec<(usize, usize)> = (0..height)
        .step_by(RUN_TILE)
        .flat_map(|top| (0..width).step_by(RUN_TILE).map(move |left| (top, left)))
        .collect();
    let tiles: Vec<Image> = windows
        .par_iter()
        .map(|&(top, left)| run_window(isa, shape, &packed, features, top, left))
        .collect();
    let mut out = Image::zeros(shape.outputs, height, width);
    for (&(top, left), tile) in windows.iter().zip(&tiles) {
        for c in 0..shape.outputs {
            for y in 0..tile.height() {
                let to = (top + y) * width + left;
                out.plane_mut(c)[to..to + tile.width()]
                    .copy_from_slice(&tile.plane(c)[y * tile.width()..(y + 1) * tile.width()]);
            }
        }
    }
    out
}

fn run_window(isa: Isa, shape: &Shape, packed: &[Packed], features: &Image, top: usize, left: usize) -> Image {
    let halo = shape.radius();
    let bottom = (top + RUN_TILE).min(features.height());
    let right = (left + RUN_TILE).min(features.width());
    let (y0, x0) = (top.saturating_sub(halo), left.saturating_sub(halo));
    let (y1, x1) = ((bottom + halo).min(features.height()), (right + halo).min(features.width()));
    let window = features.crop(y0, x0, y1 - y0, x1 - x0);
    let geometry = Geometry::new(window.height(), window.width());
    let mut current = Planes::from_planar(geometry, FEATURE_CHANNELS, window.data());
    let mut next = Planes::zeros(geometry, MAX_CHANNELS);
    for (l, packed) in packed.iter().enumerate() {
        convolve(isa, &current, packed, finish_of(shape, l), &mut next);
        if l == 0 {
            current = Planes::zeros(geometry, MAX_CHANNELS);
        }
        std::mem::swap(&mut current, &mut next);
    }
    let mut out = Image::zeros(shape.outputs, window.height(), window.width());
    current.copy_to(out.data_mut());
    out.crop(top - y0, left - x0, bottom - top, right - left)
}
