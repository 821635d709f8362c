//! The network in naive f64, one pixel at a time: the judge of the kernels, slow on purpose.

use super::{KERNEL, Shape, layer};
use crate::features::FEATURE_CHANNELS;

/// Each layer's output `[channels, height, width]` (the last one before activation) of features
/// `[13, height, width]`.
pub fn forward(shape: &Shape, weights: &[f64], features: &[f64], height: usize, width: usize) -> Vec<Vec<f64>> {
    assert_eq!(features.len(), FEATURE_CHANNELS * height * width);
    let mut layers: Vec<Vec<f64>> = Vec::new();
    for l in 0..shape.layers {
        let (inputs, outputs) = shape.channels(l);
        let (kernel, bias) = layer(shape, weights, l);
        let input = layers.last().map_or(features, Vec::as_slice);
        let mut output = vec![0.0; outputs * height * width];
        for (o, bias) in bias.iter().enumerate() {
            for y in 0..height {
                for x in 0..width {
                    let mut sum = *bias;
                    for i in 0..inputs {
                        for (row, column, weight) in taps(&kernel[(o * inputs + i) * KERNEL * KERNEL..]) {
                            if let Some(at) = neighbour(y, x, row, column, height, width) {
                                sum += weight * input[i * height * width + at];
                            }
                        }
                    }
                    let relu = l + 1 < shape.layers;
                    output[(o * height + y) * width + x] = if relu { sum.max(0.0) } else { sum };
                }
            }
        }
        layers.push(output);
    }
    layers
}

/// Gradient of the flat weights, given the gradient of the last layer's output.
pub fn backward(
    shape: &Shape,
    weights: &[f64],
    features: &[f64],
    height: usize,
    width: usize,
    upstream: &[f64],
) -> Vec<f64> {
    let layers = forward(shape, weights, features, height, width);
    let pixels = height * width;
    let mut gradient = vec![0.0; shape.parameter_count()];
    let mut current = upstream.to_vec();
    for l in (0..shape.layers).rev() {
        let (inputs, outputs) = shape.channels(l);
        let (kernel, _) = layer(shape, weights, l);
        let input = if l == 0 { features } else { &layers[l - 1] };
        let start = shape.layer_start(l);
        let mut next = vec![0.0; inputs * pixels];
        for o in 0..outputs {
            for y in 0..height {
                for x in 0..width {
                    let g = current[o * pixels + y * width + x];
                    gradient[start + outputs * inputs * KERNEL * KERNEL + o] += g;
                    for i in 0..inputs {
                        let base = (o * inputs + i) * KERNEL * KERNEL;
                        for (row, column, weight) in taps(&kernel[base..]) {
                            if let Some(at) = neighbour(y, x, row, column, height, width) {
                                gradient[start + base + row * KERNEL + column] += g * input[i * pixels + at];
                                next[i * pixels + at] += g * weight;
                            }
                        }
                    }
                }
            }
        }
        if l > 0 {
            for (n, a) in next.iter_mut().zip(&layers[l - 1]) {
                if *a <= 0.0 {
                    *n = 0.0;
                }
            }
        }
        current = next;
    }
    gradient
}

fn taps(kernel: &[f64]) -> impl Iterator<Item = (usize, usize, f64)> + '_ {
    (0..KERNEL * KERNEL).map(|t| (t / KERNEL, t % KERNEL, kernel[t]))
}

fn neighbour(y: usize, x: usize, row: usize, column: usize, height: usize, width: usize) -> Option<usize> {
    let y = (y + row).checked_sub(KERNEL / 2)?;
    let x = (x + column).checked_sub(KERNEL / 2)?;
    (y < height && x < width).then_some(y * width + x)
}
