//! The network for inference: over one window at a time; weights packed once, nothing saved.

use super::conv::Packed;
use super::{Network, Shape, layer, rows};
use crate::features::FEATURE_CHANNELS;
use crate::parameters::{Form, activate};
use crate::region::Region;
use crate::simd::Isa;

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

    /// Channels and layers.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// Which parameters it gives.
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
}
