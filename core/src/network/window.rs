//! The network over one window at a time, for inference: weights packed once, nothing saved.

use super::conv::{Finish, Packed, convolve};
use super::planes::{Geometry, Planes};
use super::{MAX_CHANNELS, Network, Shape, layer};
use crate::features::FEATURE_CHANNELS;
use crate::parameters::{Form, activate};
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
        let pixels = height * width;
        assert_eq!(features.len(), FEATURE_CHANNELS * pixels, "features of the window");
        assert_eq!(out.len(), self.shape.outputs * pixels, "parameters of the window");
        if pixels == 0 {
            return;
        }
        let geometry = Geometry::new(height, width);
        let mut current = Planes::zeros(geometry, MAX_CHANNELS);
        current.fill(features);
        let mut next = Planes::zeros(geometry, MAX_CHANNELS);
        for (l, packed) in self.layers.iter().enumerate() {
            let last = l + 1 == self.layers.len();
            let finish = if last { Finish::Linear } else { Finish::Relu };
            convolve(self.isa, &current, packed, finish, &mut next);
            std::mem::swap(&mut current, &mut next);
        }
        current.copy_to(out);
        activate(self.isa, self.form, out);
    }
}
