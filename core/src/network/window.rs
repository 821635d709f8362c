//! The network for inference: over one window at a time, or over a picture in windows; weights packed
//! once, nothing saved.

use super::conv::Packed;
use super::{Network, Shape, layer, rows};
use crate::features::FEATURE_CHANNELS;
use crate::gc::Region;
use crate::image::Image;
use crate::parameters::{Form, activate};
use crate::plan::Plan;
use crate::simd::Isa;
use rayon::prelude::*;
use std::ops::Range;

/// Side of the windows that a picture is computed in, without their halo.
const PICTURE_WINDOW: usize = 128;

/// A network ready to run over windows of any size, from any number of threads.
pub struct WindowNetwork {
    isa: Isa,
    form: Form,
    shape: Shape,
    layers: Vec<Packed>,
}

impl std::fmt::Debug for WindowNetwork {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(out, "WindowNetwork({:?}, {:?}, {})", self.form, self.shape, self.isa.name())
    }
}

impl WindowNetwork {
    /// Packs the weights of `network`, whose outputs are the parameters of `form`.
    ///
    /// # Panics
    /// When the network's outputs are not the form's parameters, or weights are missing.
    pub fn new(isa: Isa, form: Form, network: &Network) -> Self {
        let shape = network.shape;
        assert_eq!(shape.outputs, form.parameters(), "one output per parameter");
        assert_eq!(network.weights.len(), shape.parameter_count(), "flat weights");
        let layers = (0..shape.layers)
            .map(|l| {
                let (kernel, bias) = layer(&shape, &network.weights, l);
                Packed::forward(isa, shape.channels(l).0, kernel, bias)
            })
            .collect();
        Self { isa, form, shape, layers }
    }

    pub fn shape(&self) -> Shape {
        self.shape
    }

    pub fn form(&self) -> Form {
        self.form
    }

    /// Activated parameters `[P, height, width]` of features `[13, height, width]`, with zero
    /// padding around the window.
    ///
    /// # Panics
    /// When a slice has another length.
    pub fn run(&self, features: &[f32], height: usize, width: usize, out: &mut [f32]) {
        self.run_inner(features, height, width, Region { top: 0, left: 0, height, width }, out);
    }

    /// The same for the pixels `inner` of the window, `[P, inner.height, inner.width]`. Where the
    /// window's edge is not the picture's, the inner pixels must lie [`Shape::radius`] away from it.
    ///
    /// # Panics
    /// When a slice has another length, or the inner pixels leave the window.
    pub fn run_inner(&self, features: &[f32], height: usize, width: usize, inner: Region, out: &mut [f32]) {
        assert_eq!(features.len(), FEATURE_CHANNELS * height * width, "features of the window");
        assert_eq!(out.len(), self.shape.outputs * inner.pixels(), "parameters of the inner pixels");
        assert!(
            inner.top + inner.height <= height && inner.left + inner.width <= width,
            "inner pixels leave the window"
        );
        if inner.pixels() == 0 {
            return;
        }
        rows::run(self.isa, &self.layers, features, height, width, inner, out);
        activate(self.isa, self.form, out);
    }

    /// Activated parameters `[P, H, W]` of a picture's features `[13, H, W]`, zero in windows that the
    /// plan skips. Windows have a halo of the network's radius; at the picture's border the zero
    /// padding of every layer is exact, so the tiling does not show.
    pub fn run_picture(&self, features: &Image, plan: &Plan) -> Image {
        self.run_rows(features, plan, 0..features.height())
    }

    /// The same for some `rows` of the picture, `[P, rows, W]`.
    pub fn run_rows(&self, features: &Image, plan: &Plan, rows: Range<usize>) -> Image {
        let width = features.width();
        let windows: Vec<Region> = rows
            .clone()
            .step_by(PICTURE_WINDOW)
            .flat_map(|top| (0..width).step_by(PICTURE_WINDOW).map(move |left| (top, left)))
            .map(|(top, left)| Region {
                top,
                left,
                height: PICTURE_WINDOW.min(rows.end - top),
                width: PICTURE_WINDOW.min(width - left),
            })
            .filter(|window| plan.touches(window))
            .collect();
        let tiles: Vec<Image> = windows.par_iter().map(|window| self.run_with_halo(features, window)).collect();
        let mut out = Image::zeros(self.shape.outputs, rows.len(), width);
        for (window, tile) in windows.iter().zip(&tiles) {
            for c in 0..self.shape.outputs {
                for (y, row) in tile.plane(c).chunks_exact(window.width).enumerate() {
                    let to = (window.top - rows.start + y) * width + window.left;
                    out.plane_mut(c)[to..to + window.width].copy_from_slice(row);
                }
            }
        }
        out
    }

    fn run_with_halo(&self, features: &Image, window: &Region) -> Image {
        let halo = self.shape.radius();
        let (top, left) = (window.top.saturating_sub(halo), window.left.saturating_sub(halo));
        let bottom = (window.top + window.height + halo).min(features.height());
        let right = (window.left + window.width + halo).min(features.width());
        let input = features.crop(top, left, bottom - top, right - left);
        let inner = Region { top: window.top - top, left: window.left - left, ..*window };
        let mut out = Image::zeros(self.shape.outputs, window.height, window.width);
        self.run_inner(input.data(), input.height(), input.width(), inner, out.data_mut());
        out
    }
}
