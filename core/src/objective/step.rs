//! One training step: the loss of some tiles and its gradient by the network's weights.
//!
//! Each tile goes through the network, g_c, the loss and all the way back on one thread while its
//! planes are in that core's cache; threads meet once a step, when the tiles' gradients are summed. Where more threads can
//! run at once than a step has tiles, each tile is computed in parts; the values are the same to the bit.

use super::loss::{Objective, PixelLoss, Scratch};
use super::tile::Tile;
use crate::threads::at_once;
use rayon::prelude::*;
use sspc_kernels::network::{GradientPlanes, PackedNetwork, Shape, TilePlanes, sum_in_order};
use sspc_kernels::simd::Isa;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Most parts of a tile: of 48 rows each has six. Fewer rows cost more per pixel, eight of them a fifth more than 48.
const MOST_PARTS: usize = 8;

/// In how many parts each of some tiles is computed at once, where so many threads can run.
pub fn parts_of_tile(tiles: usize, threads: usize) -> usize {
    threads.div_ceil(tiles.max(1)).clamp(1, MOST_PARTS)
}

/// What a step is computed with.
pub struct Step<'a> {
    /// The frame.
    pub objective: &'a Objective,
    /// The network.
    pub shape: Shape,
    /// Instruction set of the kernels.
    pub isa: Isa,
    /// The limit of [`Objective::loss`].
    pub influence: f32,
    /// Network outputs that training leaves alone: nothing flows back through them.
    pub frozen_outputs: Range<usize>,
}

/// What a tile needs on its way, of one size and shape; used again by later tiles.
struct Workspace {
    size: (usize, usize, Shape),
    features: Vec<f32>,
    outputs: Vec<f32>,
    gradient: Vec<f32>,
    planes: TilePlanes,
    back: GradientPlanes,
    scratch: Scratch,
}

impl Workspace {
    fn new(size: (usize, usize, Shape)) -> Self {
        let (height, width, shape) = size;
        let planes = TilePlanes::new(&shape, height, width);
        Self {
            size,
            features: Vec::new(),
            outputs: vec![0.0; shape.outputs * height * width],
            gradient: vec![0.0; shape.outputs * height * width],
            back: GradientPlanes::of(&planes),
            planes,
            scratch: Scratch::default(),
        }
    }
}

/// Workspaces of earlier steps, one for each thread that took part: some 1.5 MiB for a tile of 48 x 48
/// and three layers.
#[derive(Default)]
pub struct Workspaces(Mutex<Vec<Workspace>>);

impl Workspaces {
    fn take(&self, size: (usize, usize, Shape)) -> Workspace {
        let kept = self.0.lock().unwrap_or_else(PoisonError::into_inner).pop();
        kept.filter(|workspace| workspace.size == size).unwrap_or_else(|| Workspace::new(size))
    }

    fn give_back(&self, workspace: Workspace) {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).push(workspace);
    }
}

impl Step<'_> {
    /// The mean of the loss (Eq. 9) over the pixels and channels of `tiles`, and its gradient by the
    /// flat `weights`. Tiles are summed in their order, whatever the number of threads.
    ///
    /// # Panics
    /// When the weights are not those of the shape, or the shape's outputs not those of the form.
    pub fn run(&self, weights: &[f32], tiles: &[Tile], workspaces: &Workspaces) -> (f64, Vec<f32>) {
        self.run_in_parts(weights, tiles, workspaces, parts_of_tile(tiles.len(), at_once()))
    }

    /// The same with each tile in `parts` parts at once: the same values for any number of them.
    ///
    /// # Panics
    /// As [`Self::run`].
    pub fn run_in_parts(
        &self,
        weights: &[f32],
        tiles: &[Tile],
        workspaces: &Workspaces,
        parts: usize,
    ) -> (f64, Vec<f32>) {
        assert_eq!(self.shape.outputs, self.objective.form.parameters(), "outputs of the form");
        let network = PackedNetwork::new(self.isa, self.shape, weights).in_parts(parts);
        let pixels: usize = tiles.iter().map(|t| t.region.pixels()).sum();
        let scale = 1.0 / (3 * pixels.max(1)) as f32;
        let of_tile = |tile: &Tile| {
            let mut workspace = workspaces.take((tile.region.height, tile.region.width, self.shape));
            let mut gradient = vec![0.0; weights.len()];
            workspace.scratch.parts = parts;
            let loss = self.tile(&network, tile, scale, &mut workspace, &mut gradient);
            workspaces.give_back(workspace);
            (loss, gradient)
        };
        let (losses, gradients): (Vec<f64>, Vec<Vec<f32>>) = tiles.par_iter().map(of_tile).unzip();
        (losses.iter().sum(), sum_in_order(&gradients))
    }

    fn tile(
        &self,
        network: &PackedNetwork,
        tile: &Tile,
        scale: f32,
        workspace: &mut Workspace,
        gradient: &mut [f32],
    ) -> f64 {
        let Workspace { features, outputs, gradient: by_outputs, planes, back, scratch, .. } = workspace;
        features.clear();
        self.objective.append_features(tile, features);
        network.forward(planes, features, outputs);
        let measure = PixelLoss { scale, influence: self.influence };
        let loss = self.objective.loss(self.isa, tile, outputs, measure, by_outputs, scratch);
        let pixels = tile.region.pixels();
        by_outputs[self.frozen_outputs.start * pixels..self.frozen_outputs.end * pixels].fill(0.0);
        network.backward(planes, back, by_outputs, gradient);
        loss
    }
}
