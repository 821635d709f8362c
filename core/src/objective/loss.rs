//! The loss of tiles by the network's outputs, and its gradient.

use super::differences::DifferenceTarget;
use super::{RELATIVE_FLOOR, Tile, own_weight, relative_weight};
use crate::prepare::Prepared;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::{Correction, Given, ParameterPlanes, Taps, Upstream};
use sspc_kernels::loss::{Differences, SelfSupervised};
use sspc_kernels::parameters::{Form, activate, activate_backward};
use sspc_kernels::region::Region;
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
    /// What differences of this half's correction are compared with, where the renderer gave any.
    pub differences: Option<DifferenceTarget>,
}

/// Both halves of a frame, ready to be trained on.
#[derive(Clone, Debug)]
pub struct Objective {
    /// Which corrector is fitted.
    pub form: Form,
    /// Window of g_c.
    pub taps: Taps,
    /// The first half and the second.
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
                target: Image::from_rows(3, other.height(), other.width(), |k, y, row| {
                    row.copy_from_slice(prepared.target_row(h, k, y));
                }),
                weight: relative_weight(other, prepared.valid.as_ref(), RELATIVE_FLOOR),
                differences: None,
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

    /// The same with differences of the correction compared with those of the other half, where the frame has them
    /// ([`DifferenceTarget`]).
    pub fn with_differences(mut self, prepared: &Prepared) -> Self {
        if let Some(given) = &prepared.differences {
            for (h, half) in self.halves.iter_mut().enumerate() {
                half.differences = Some(DifferenceTarget::new(given, h, &half.weight));
            }
        }
        self
    }

    /// The same without the pixels that training leaves out ([`crate::held_out`]).
    pub fn without_held_out(mut self) -> Self {
        for half in &mut self.halves {
            crate::held_out::blind(&mut half.weight);
            if let Some(differences) = &mut half.differences {
                differences.leave_out(crate::held_out::is_held_out);
            }
        }
        self
    }

    /// Appends the features of a tile, mirrored as it says, `[13, h, w]`.
    pub fn append_features(&self, tile: &Tile, out: &mut Vec<f32>) {
        let Tile { half, region, mirror } = tile;
        let (features, first) = (self.halves[*half].planes.features(), out.len());
        for (c, y) in (0..FEATURE_CHANNELS).flat_map(|c| (0..region.height).map(move |y| (c, y))) {
            out.extend_from_slice(&features.row(c, region.top + y)[region.left..region.left + region.width]);
        }
        mirror.apply(&mut out[first..], region.height, region.width);
    }

    /// The loss of a tile, Σ over pixels and channels of weighted squared errors times the scale, of the network's
    /// `outputs` `[P, h, w]`, mirrored as the tile says; their gradient, to train on, is written to `gradient`.
    ///
    /// With an infinite influence that is the loss's own gradient. With a limit m it is the gradient of
    /// Σ 2m² (√(1 + e²/m²) - 1), where e² is a pixel's weighted squared error (pseudo-Huber): outliers of y lose their
    /// say over the parameters, while no radiance is changed and the value returned stays that of the plain loss.
    ///
    /// Where the frame has differences of y, those between the tile's pixels take part in the same way.
    ///
    /// # Panics
    /// When a slice has another length, or the tile leaves the picture.
    pub fn loss(
        &self,
        isa: Isa,
        tile: &Tile,
        outputs: &[f32],
        PixelLoss { scale, influence }: PixelLoss,
        gradient: &mut [f32],
        scratch: &mut Scratch,
    ) -> f64 {
        let Tile { half, region, mirror } = *tile;
        let HalfObjective { planes, target, weight, differences } = &self.halves[half];
        let Scratch { parts, parameters, corrected, padded, upstream } = scratch;
        parameters.clear();
        parameters.extend_from_slice(outputs);
        mirror.undo(parameters, region.height, region.width);
        activate(isa, self.form, parameters);
        corrected.resize(3 * region.pixels(), 0.0);
        let view = ParameterPlanes::of_region(self.form, parameters, &region);
        let windows = planes.windows(region, std::mem::take(padded));
        let judge_of = |region| SelfSupervised { target, weight, region, scale, influence, squares: Vec::new() };
        let pixels = Correction { windows: &windows, taps: &self.taps, region: region.at_origin(), parameters: view };
        let squares = match differences {
            None => {
                let judge_of = |part: Region| {
                    judge_of(Region { top: region.top + part.top, left: region.left + part.left, ..part })
                };
                backward(isa, pixels, *parts, judge_of, corrected, gradient).into_iter().flat_map(|j| j.squares).sum()
            }
            // A pixel's gradient needs μ̂ of its neighbours: it comes between two passes.
            Some(DifferenceTarget { target, weight }) => {
                let mut judge = judge_of(region);
                pixels.forward(isa, corrected);
                upstream.resize(corrected.len(), 0.0);
                judge.of_tile(isa, Differences { target, weight }, corrected, upstream);
                pixels.backward(isa, &mut Given::new(upstream, region.at_origin()), corrected, gradient);
                judge.squares.iter().sum::<f64>()
            }
        };
        *padded = windows.into_data();
        mirror.apply(gradient, region.height, region.width);
        activate_backward(isa, self.form, outputs, gradient);
        squares * f64::from(scale)
    }
}

/// How the loss of a pixel is measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelLoss {
    /// Factor of every pixel's loss.
    pub scale: f32,
    /// The weighted error norm m from which a pixel's gradient is limited, > 0.
    pub influence: f32,
}

/// g_c of a tile and its gradient, in parts at once where there are to be several; what they were judged by, in their order.
fn backward<U: Upstream + Send>(
    isa: Isa,
    tile: Correction,
    parts: usize,
    judge_of: impl Fn(Region) -> U + Sync,
    corrected: &mut [f32],
    gradient: &mut [f32],
) -> Vec<U> {
    if parts <= 1 {
        let mut judge = judge_of(tile.region);
        tile.backward(isa, &mut judge, corrected, gradient);
        return vec![judge];
    }
    let of_part = |part: Correction| {
        let (pixels, mut judge) = (part.region.pixels(), judge_of(part.region));
        let mut corrected = vec![0.0; 3 * pixels];
        let mut gradient = vec![0.0; part.parameters.form.parameters() * pixels];
        part.backward(isa, &mut judge, &mut corrected, &mut gradient);
        (part.region, corrected, gradient, judge)
    };
    let done: Vec<_> = tile.in_parts(parts).into_par_iter().map(of_part).collect();
    let put = |part: (Region, Vec<f32>, Vec<f32>, U)| {
        let (region, of_part, gradient_of_part, judge) = part;
        put_part(tile.region, region, &of_part, corrected);
        put_part(tile.region, region, &gradient_of_part, gradient);
        judge
    };
    done.into_iter().map(put).collect()
}

/// Puts planes of a part of a tile into the tile's.
fn put_part(tile: Region, part: Region, from: &[f32], to: &mut [f32]) {
    let planes = from.chunks_exact(part.pixels()).zip(to.chunks_exact_mut(tile.pixels()));
    for (from, to) in planes {
        for (y, row) in from.chunks_exact(part.width).enumerate() {
            let at = (part.top - tile.top + y) * tile.width + part.left - tile.left;
            to[at..at + part.width].copy_from_slice(row);
        }
    }
}

/// Memory of [`Objective::loss`], used again by the next tile: activated parameters, corrected radiance, the
/// tile's padded features, and the gradient by μ̂ where differences are compared.
#[derive(Debug, Default)]
pub struct Scratch {
    /// In how many parts g_c of a tile is computed at once.
    pub(super) parts: usize,
    parameters: Vec<f32>,
    corrected: Vec<f32>,
    padded: Vec<f32>,
    upstream: Vec<f32>,
}

impl Scratch {
    /// The same for tiles whose g_c is computed in some parts at once.
    pub fn in_parts(parts: usize) -> Self {
        Self { parts, ..Self::default() }
    }
}
