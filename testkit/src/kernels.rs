//! The kernels over whole pictures, as a fit uses them tile by tile.

use sspc_core::objective::{Objective, PixelLoss, Scratch, Tile};
use sspc_kernels::gc::{Correction, Given, ParameterPlanes, Taps};
use sspc_kernels::network::{GradientPlanes, PackedNetwork, Shape, TilePlanes};
use sspc_kernels::parameters::{Form, activate};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;

/// A network that has gone through one picture.
pub struct Pass {
    network: PackedNetwork,
    planes: TilePlanes,
    parameter_count: usize,
    /// Network outputs before activation, `[outputs, height, width]`.
    pub outputs: Vec<f32>,
}

impl Pass {
    /// Takes features `[13, height, width]` through a network of flat `weights`.
    ///
    /// # Panics
    /// When a slice has another length.
    pub fn forward(isa: Isa, shape: &Shape, weights: &[f32], features: &[f32], height: usize, width: usize) -> Self {
        let network = PackedNetwork::new(isa, *shape, weights);
        let mut planes = TilePlanes::new(shape, height, width);
        let mut outputs = vec![0.0; shape.outputs * height * width];
        network.forward(&mut planes, features, &mut outputs);
        Self { network, planes, parameter_count: shape.parameter_count(), outputs }
    }

    /// Gradient of the flat weights, given that of the outputs.
    pub fn backward(&self, upstream: &[f32]) -> Vec<f32> {
        self.backward_through(&self.network, upstream)
    }

    /// The same through the transposed kernels of another network: to see a fault of the backward pass alone.
    pub fn backward_through(&self, network: &PackedNetwork, upstream: &[f32]) -> Vec<f32> {
        let mut gradient = vec![0.0; self.parameter_count];
        network.backward(&self.planes, &mut GradientPlanes::of(&self.planes), upstream, &mut gradient);
        gradient
    }
}

/// Activated parameters of raw network `outputs` `[P, H, W]`.
pub fn activated(isa: Isa, form: Form, outputs: &[f32]) -> Vec<f32> {
    let mut parameters = outputs.to_vec();
    activate(isa, form, &mut parameters);
    parameters
}

/// μ̂ of a region, `[3, h, w]`, of its activated `parameters` `[P, h, w]`.
pub fn correct(isa: Isa, form: Form, windows: &Windows, taps: &Taps, region: Region, parameters: &[f32]) -> Vec<f32> {
    let parameters = ParameterPlanes::of_region(form, parameters, &region);
    let mut out = vec![0.0; 3 * region.pixels()];
    Correction { windows, taps, region, parameters }.forward(isa, &mut out);
    out
}

/// The same, and the gradient of the parameters given that of μ̂, `upstream` `[3, h, w]`.
pub fn correct_and_back(
    isa: Isa,
    form: Form,
    windows: &Windows,
    taps: &Taps,
    region: Region,
    parameters: &[f32],
    upstream: &[f32],
) -> (Vec<f32>, Vec<f32>) {
    let (mut out, mut gradient) = (vec![0.0; 3 * region.pixels()], vec![0.0; parameters.len()]);
    let parameters = ParameterPlanes::of_region(form, parameters, &region);
    let correction = Correction { windows, taps, region, parameters };
    correction.backward(isa, &mut Given::new(upstream, region), &mut out, &mut gradient);
    (out, gradient)
}

/// The loss of tiles of one size and its gradient by their outputs `[tiles, P, h, w]`.
pub fn loss_of_tiles(
    objective: &Objective,
    isa: Isa,
    tiles: &[Tile],
    outputs: &[f32],
    measure: PixelLoss,
) -> (f64, Vec<f32>) {
    let mut gradient = vec![0.0; outputs.len()];
    let (scratch, size) = (&mut Scratch::default(), outputs.len() / tiles.len());
    let each = tiles.iter().zip(outputs.chunks_exact(size)).zip(gradient.chunks_exact_mut(size));
    let loss = each.map(|((tile, outputs), gradient)| objective.loss(isa, tile, outputs, measure, gradient, scratch));
    let sum = loss.sum();
    (sum, gradient)
}

/// Features of one tile, `[13, h, w]`, mirrored as it says.
pub fn features_of(objective: &Objective, tile: &Tile) -> Vec<f32> {
    let mut features = Vec::new();
    objective.append_features(tile, &mut features);
    features
}
