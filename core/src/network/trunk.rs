//! The whole network over a batch of tiles: forward with saved activations, and backward.

use super::conv::{Finish, Packed, convolve, weight_gradient};
use super::planes::{Geometry, Planes};
use super::{MAX_CHANNELS, Shape, layer};
use crate::features::FEATURE_CHANNELS;
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
