//! The loss of tiles by the network's outputs, and its gradient.

use super::{RELATIVE_FLOOR, Tile, own_weight, relative_weight, triple};
use crate::prepare::Prepared;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet, RADIANCE};
use sspc_kernels::gc::{self, ParameterPlanes, Taps, Upstream};
use sspc_kernels::loss::{Given, SelfSupervised};
use sspc_kernels::parameters::{Form, activate, activate_backward};
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::FeaturePlanes;
use std::sync::Arc;

/// One half, and what its correction is judged by.
#[derive(Clone, Debug)]
pub struct HalfObjective {
    /// Features of this half, for the network and for g_c.
    pub planes: FeaturePlanes,
    /// y of the other half, `[3, H, W]`.
    pub target: Image,
    /// Weight of a pixel's squared error, 0 where missing: 1 / (z̄² + 0.01) of the other half (the
    /// paper's), or of this one.
    pub weight: Image,
}

/// Both halves of a frame, ready to be trained on.
#[derive(Clone, Debug)]
pub struct Objective {
    pub form: Form,
    pub taps: Taps,
    pub halves: [HalfObjective; 2],
}

impl Objective {
    /// The paper's objective of a frame (Eqs. 8, 9).
    pub fn new(prepared: &Prepared, form: Form, taps: Taps, set: FeatureSet) -> Self {
        let valid = prepared.valid.clone().map(Arc::new);
        let half = |h: usize| {
            let other = &prepared.halves[1 - h];
            HalfObjective {
                planes: FeaturePlanes::new(prepared.halves[h].clone(), valid.clone(), set, taps.radius()),
                target: triple(other, RADIANCE),
                weight: relative_weight(other, prepared.valid.as_ref(), RELATIVE_FLOOR),
            }
        };
        Self { form, halves: [half(0), half(1)], taps }
    }

    /// The same with [`own_weight`].
    pub fn with_own_weight(mut self, prepared: &Prepared) -> Self {
        for (h, half) in self.halves.iter_mut().enumerate() {
            half.weight = own_weight(prepared, h);
        }
        self
    }

    /// Features of equally large tiles, mirrored as each tile says, `[tiles, 13, h, w]`.
    pub fn tile_features(&self, tiles: &[Tile]) -> Vec<f32> {
        let mut out = Vec::with_capacity(tiles.iter().map(|t| FEATURE_CHANNELS * t.region.pixels()).sum());
        tiles.iter().for_each(|tile| self.append_features(tile, &mut out));
        out
    }

    /// Appends one tile's features.
    pub(super) fn append_features(&self, tile: &Tile, out: &mut Vec<f32>) {
        let Tile { half, region, mirror } = tile;
        let (features, first) = (self.halves[*half].planes.features(), out.len());
        for (c, y) in (0..FEATURE_CHANNELS).flat_map(|c| (0..region.height).map(move |y| (c, y))) {
            out.extend_from_slice(&features.row(c, region.top + y)[region.left..region.left + region.width]);
        }
        mirror.apply(&mut out[first..], region.height, region.width);
    }

    /// Corrected radiance of equally large tiles, `[tiles, 3, h, w]`, as they lie in the picture, of
    /// the network's `outputs` `[tiles, P, h, w]`, mirrored as each tile says.
    pub fn correct(&self, isa: Isa, tiles: &[Tile], outputs: &[f32]) -> Vec<f32> {
        let pixels = self.check(tiles, outputs);
        let mut out = vec![0.0; tiles.len() * 3 * pixels];
        if pixels > 0 {
            out.par_chunks_mut(3 * pixels)
                .zip(outputs.par_chunks(self.form.parameters() * pixels))
                .zip(tiles)
                .for_each(|((out, outputs), tile)| {
                    let parameters = self.activated(isa, tile, outputs);
                    let view = ParameterPlanes::of_region(self.form, &parameters, &tile.region);
                    let windows = self.halves[tile.half].planes.windows(tile.region, Vec::new());
                    gc::forward(isa, &windows, &self.taps, tile.region.at_origin(), view, out);
                });
        }
        out
    }

    /// Gradient of `outputs`, given the gradient of [`Self::correct`]'s result.
    pub fn correct_backward(&self, isa: Isa, tiles: &[Tile], outputs: &[f32], upstream: &[f32]) -> Vec<f32> {
        let pixels = self.check(tiles, outputs).max(1);
        assert_eq!(upstream.len(), 3 * tiles.iter().map(|t| t.region.pixels()).sum::<usize>(), "upstream gradient");
        let mut gradient = vec![0.0; outputs.len()];
        gradient
            .par_chunks_mut(self.form.parameters() * pixels)
            .zip(outputs.par_chunks(self.form.parameters() * pixels))
            .zip(upstream.par_chunks(3 * pixels))
            .zip(tiles)
            .for_each(|(((gradient, outputs), upstream), tile)| {
                let mut given = Given { upstream, region: tile.region };
                self.tile_backward(isa, tile, outputs, &mut given, gradient, &mut Scratch::default());
            });
        gradient
    }

    /// The loss of tiles, Σ over pixels and channels of weighted squared errors times `scale`, and a
    /// gradient by `outputs` to train on.
    ///
    /// With an infinite `influence` that is the loss's own gradient. With a limit m it is the
    /// gradient of Σ 2m² (√(1 + e²/m²) - 1), where e² is a pixel's weighted squared error: outliers
    /// of y lose their say over the parameters, while no radiance is changed and the value returned
    /// stays that of the plain loss.
    pub fn loss(&self, isa: Isa, tiles: &[Tile], outputs: &[f32], scale: f32, influence: f32) -> (f64, Vec<f32>) {
        let pixels = self.check(tiles, outputs).max(1);
        let mut gradient = vec![0.0; outputs.len()];
        let losses: Vec<f64> = gradient
            .par_chunks_mut(self.form.parameters() * pixels)
            .zip(outputs.par_chunks(self.form.parameters() * pixels))
            .zip(tiles)
            .map(|((gradient, outputs), tile)| {
                let scratch = &mut Scratch::default();
                self.tile_loss(isa, tile, outputs, (scale, influence), gradient, scratch)
            })
            .collect();
        (losses.iter().sum(), gradient)
    }

    /// Pixels of every tile.
    fn check(&self, tiles: &[Tile], outputs: &[f32]) -> usize {
        let pixels = tiles.first().map_or(0, |t| t.region.pixels());
        assert!(tiles.iter().all(|t| t.region.pixels() == pixels), "tiles of one size");
        assert_eq!(outputs.len(), tiles.len() * self.form.parameters() * pixels, "network outputs of the tiles");
        pixels
    }

    /// Parameters of a tile as it lies in the picture.
    fn activated(&self, isa: Isa, tile: &Tile, outputs: &[f32]) -> Vec<f32> {
        let mut parameters = Vec::new();
        self.activate(isa, tile, outputs, &mut parameters);
        parameters
    }

    fn activate(&self, isa: Isa, tile: &Tile, outputs: &[f32], parameters: &mut Vec<f32>) {
        parameters.clear();
        parameters.extend_from_slice(outputs);
        tile.mirror.undo(parameters, tile.region.height, tile.region.width);
        activate(isa, self.form, parameters);
    }

    /// [`Self::loss`] of one tile, given its `scale` and limit of influence.
    pub(super) fn tile_loss(
        &self,
        isa: Isa,
        tile: &Tile,
        outputs: &[f32],
        (scale, influence): (f32, f32),
        gradient: &mut [f32],
        scratch: &mut Scratch,
    ) -> f64 {
        let half = &self.halves[tile.half];
        let (target, weight) = (&half.target, &half.weight);
        let mut judge = SelfSupervised { target, weight, region: tile.region, scale, influence, sum: 0.0 };
        self.tile_backward(isa, tile, outputs, &mut judge, gradient, scratch);
        judge.sum * f64::from(scale)
    }

    fn tile_backward<U: Upstream>(
        &self,
        isa: Isa,
        tile: &Tile,
        outputs: &[f32],
        upstream: &mut U,
        gradient: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let Scratch { parameters, corrected, padded } = scratch;
        self.activate(isa, tile, outputs, parameters);
        corrected.resize(3 * tile.region.pixels(), 0.0);
        let view = ParameterPlanes::of_region(self.form, parameters, &tile.region);
        let windows = self.halves[tile.half].planes.windows(tile.region, std::mem::take(padded));
        gc::backward(isa, &windows, &self.taps, tile.region.at_origin(), view, upstream, corrected, gradient);
        *padded = windows.into_data();
        tile.mirror.apply(gradient, tile.region.height, tile.region.width);
        activate_backward(isa, self.form, outputs, gradient);
    }
}

/// What a tile's backward pass writes on the way: activated parameters, corrected radiance, and the
/// tile's padded features.
#[derive(Default)]
pub(super) struct Scratch {
    parameters: Vec<f32>,
    corrected: Vec<f32>,
    padded: Vec<f32>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::objective::Mirror;
    use crate::prepare::Exposure;
    use crate::rng::Rng;
    use sspc_image::{Frame, HalfBuffer};
    use sspc_kernels::features::DENOISED;
    use sspc_kernels::region::Region;

    fn prepared(rng: &mut Rng) -> Prepared {
        let mut half = || {
            let mut image = |channels| Image::from_fn(channels, 21, 26, |_, _, _| rng.uniform());
            let radiance = image(3);
            let denoised = image(3);
            HalfBuffer { albedo: Some(image(3)), normal: Some(image(3)), visibility: None, radiance, denoised }
        };
        let (a, b) = (half(), half());
        let frame = Frame { a, b, denoised: None, sources: Vec::new(), warnings: Vec::new() };
        Prepared::new(&frame, Exposure::AsIs)
    }

    #[test]
    fn a_weight_is_of_the_other_half_or_the_own_and_0_where_a_pixel_is_missing() {
        let mut prepared = prepared(&mut Rng::new(2));
        for (h, z) in [(0, [0.1, 0.2, 0.3]), (1, [0.5, 0.6, 0.7])] {
            let half = Arc::make_mut(&mut prepared.halves[h]);
            (0..3).for_each(|k| half.set(DENOISED + k, 3, 4, z[k]));
        }
        let mut valid = Image::filled(1, prepared.height(), prepared.width(), 1.0);
        valid.set(0, 20, 25, 0.0);
        prepared.valid = Some(valid);
        let objective = Objective::new(&prepared, Form::Gated, Taps::square(2), prepared.set);
        // z̄ is 0.2 and 0.6.
        let expect = |objective: &Objective, expected: [f32; 2]| {
            for (half, expected) in objective.halves.iter().zip(expected) {
                assert!((half.weight.at(0, 3, 4) - expected).abs() < 1e-4, "{} {expected}", half.weight.at(0, 3, 4));
                assert_eq!(half.weight.at(0, 20, 25), 0.0);
            }
        };
        expect(&objective, [1.0 / 0.37, 1.0 / 0.05]);
        expect(&objective.with_own_weight(&prepared), [1.0 / 0.05, 1.0 / 0.37]);
    }

    #[test]
    fn a_mirrored_tile_is_the_same_tile_to_g_c_and_the_loss() {
        let mut rng = Rng::new(5);
        let prepared = prepared(&mut rng);
        let objective = Objective::new(&prepared, Form::Gated, Taps::square(2), prepared.set);
        let region = Region { top: 4, left: 7, height: 9, width: 9 };
        let outputs: Vec<f32> = (0..16 * region.pixels()).map(|_| rng.normal()).collect();
        let isa = Isa::best();
        let upright = [Tile::upright(1, region)];
        let (loss, gradient) = objective.loss(isa, &upright, &outputs, 0.1, 1.0);
        for bits in 1..8 {
            let [rows, columns, diagonal] = [1, 2, 4].map(|bit| bits & bit != 0);
            let mirror = Mirror { rows, columns, diagonal };
            let mirrored = |values: &[f32]| {
                let mut values = values.to_vec();
                mirror.apply(&mut values, region.height, region.width);
                values
            };
            let tile = [Tile { mirror, ..upright[0] }];
            let features = objective.tile_features(&tile);
            assert_eq!(features, mirrored(&objective.tile_features(&upright)), "{mirror:?}");
            // The first pixel seen, and the second of the first row seen, by their places in the picture.
            let seen = |y: usize, x: usize| {
                let (y, x) = (if rows { 8 - y } else { y }, if columns { 8 - x } else { x });
                prepared.halves[1].at(0, 4 + y, 7 + x)
            };
            let second = if diagonal { seen(1, 0) } else { seen(0, 1) };
            assert_eq!(features[..2], [seen(0, 0), second], "{mirror:?}: the corner");
            assert_eq!(objective.correct(isa, &tile, &mirrored(&outputs)), objective.correct(isa, &upright, &outputs));
            let seen = objective.loss(isa, &tile, &mirrored(&outputs), 0.1, 1.0);
            assert_eq!((seen.0, seen.1), (loss, mirrored(&gradient)), "{mirror:?}");
        }
    }
}
