//! The whole network over one tile: forward with saved activations, and backward.

use super::planes::{Geometry, Planes};
use super::tile_convolution::{Finish, Packed, convolve};
use super::weight_gradient::{Room, weight_gradient};
use super::{MAX_CHANNELS, Shape, layer};
use crate::features::FEATURE_CHANNELS;
use crate::simd::Isa;

/// A network's weights in the order that the kernels read them.
pub struct PackedNetwork {
    isa: Isa,
    shape: Shape,
    /// In how many parts a layer is computed at once.
    parts: usize,
    forward: Vec<Packed>,
    /// Turned and transposed, of every layer but the first.
    transposed: Vec<Packed>,
}

/// One tile on its way through a network: the input of every layer, and the output of the last.
pub struct TilePlanes(Vec<Planes>);

impl TilePlanes {
    /// Planes for tiles of `height` x `width`.
    pub fn new(shape: &Shape, height: usize, width: usize) -> Self {
        let channels = |l| if l == 0 { FEATURE_CHANNELS } else { MAX_CHANNELS };
        Self((0..=shape.layers).map(|l| Planes::zeros(Geometry::new(height, width), channels(l))).collect())
    }

    fn geometry(&self) -> Geometry {
        self.0[0].geometry
    }
}

/// What comes back through a tile: the gradient of a layer's output, and that of its input; and room to make that of its
/// weights.
pub struct GradientPlanes {
    outputs: Planes,
    inputs: Planes,
    room: Room,
}

impl GradientPlanes {
    /// Planes for the tile.
    pub fn of(tile: &TilePlanes) -> Self {
        let planes = || Planes::zeros(tile.geometry(), MAX_CHANNELS);
        Self { outputs: planes(), inputs: planes(), room: Room::of_tile(tile.geometry()) }
    }
}

impl PackedNetwork {
    /// Packs flat `weights`.
    ///
    /// # Panics
    /// When there are more or fewer than `shape` demands.
    pub fn new(isa: Isa, shape: Shape, weights: &[f32]) -> Self {
        assert_eq!(weights.len(), shape.parameter_count(), "flat weights");
        let forward = |l| {
            let (kernel, bias) = layer(&shape, weights, l);
            Packed::forward(isa, shape.channels(l).0, kernel, bias)
        };
        let transposed = |l| {
            let (inputs, outputs) = shape.channels(l);
            Packed::transposed(isa, inputs, outputs, layer(&shape, weights, l).0)
        };
        Self {
            isa,
            shape,
            parts: 1,
            forward: (0..shape.layers).map(forward).collect(),
            transposed: (1..shape.layers).map(transposed).collect(),
        }
    }

    /// The same, each layer in some parts at once on rayon's threads; the values are the same.
    pub fn in_parts(self, parts: usize) -> Self {
        Self { parts, ..self }
    }

    /// Network outputs before activation, `[outputs, h, w]`, of features `[13, h, w]`; `tile` keeps
    /// what [`Self::backward`] needs.
    pub fn forward(&self, tile: &mut TilePlanes, features: &[f32], outputs: &mut [f32]) {
        tile.0[0].fill(features);
        for (l, packed) in self.forward.iter().enumerate() {
            let (before, after) = tile.0.split_at_mut(l + 1);
            let finish = if l + 1 == self.shape.layers { Finish::Linear } else { Finish::Relu };
            convolve(self.isa, &before[l], packed, finish, &mut after[0], self.parts);
        }
        tile.0[self.shape.layers].copy_to(outputs);
    }

    /// Adds the gradient of the flat weights to `gradient`, given that of [`Self::forward`]'s
    /// outputs for this tile.
    pub fn backward(&self, tile: &TilePlanes, back: &mut GradientPlanes, upstream: &[f32], gradient: &mut [f32]) {
        let GradientPlanes { outputs: current, inputs: next, room } = back;
        current.fill(upstream);
        for l in (0..self.shape.layers).rev() {
            let (inputs, outputs) = self.shape.channels(l);
            let start = self.shape.layer_start(l);
            let slot = &mut gradient[start..start + self.shape.layer_len(l)];
            let (isa, parts) = (self.isa, self.parts);
            weight_gradient(isa, &tile.0[l], inputs, current, outputs, room, slot, parts);
            if l > 0 {
                convolve(isa, current, &self.transposed[l - 1], Finish::MaskedBy(&tile.0[l]), next, parts);
                std::mem::swap(current, next);
            }
        }
    }
}

/// Element by element, the first vector first.
pub fn sum_in_order(vectors: &[Vec<f32>]) -> Vec<f32> {
    let mut total = vectors.first().map_or(Vec::new(), |first| vec![0.0; first.len()]);
    for vector in vectors {
        total.iter_mut().zip(vector).for_each(|(t, v)| *t += v);
    }
    total
}
