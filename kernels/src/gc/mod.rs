//! The post-correction function g_c (Eq. 10) with its cross-bilateral weights (Eq. 11), forward and
//! backward, for rectangles of a picture.
//!
//! [`Correction`] is thin: the arithmetic stands once, generic over the instruction set, in `kernel` and what it
//! calls, in the order of the data: `strip` copies rows of features close together, `pair_logarithms` computes
//! what the pixels of a pair share, `tap_sums` adds up the taps of every pixel, `from_sums` turns sums into μ̂ and
//! gradients. The naive f64 twin is [`oracle`].

mod from_sums;
mod given;
mod kernel;
pub mod oracle;
mod pair_logarithms;
mod parameter_planes;
mod strip;
mod tap_sums;
mod taps;
mod vector;

pub use given::Given;
pub use kernel::{NoUpstream, Upstream};
pub use parameter_planes::ParameterPlanes;
pub use taps::Taps;

use crate::region::Region;
use crate::simd::{Isa, dispatch};
use crate::windows::Windows;

/// Radius of the paper's window Ω_c: 19 x 19 pixels.
pub const PAPER_RADIUS: usize = 9;
/// Smallest Σw.
pub const WEIGHT_FLOOR: f32 = 1e-5;

/// What g_c is computed of.
#[derive(Clone, Copy)]
pub struct Correction<'a> {
    /// Features of the picture.
    pub windows: &'a Windows,
    /// The window Ω_c.
    pub taps: &'a Taps,
    /// Which pixels of the picture.
    pub region: Region,
    /// Their parameters.
    pub parameters: ParameterPlanes<'a>,
}

impl Correction<'_> {
    /// Corrected radiance μ̂ of the region, `[3, region.height, region.width]`: g_c in the paper's form,
    /// z + s (g_c - z) in the gated form.
    ///
    /// # Panics
    /// When the region leaves the picture, the window its padding, or the parameters do not cover the region.
    pub fn forward(self, isa: Isa, out: &mut [f32]) {
        self.run(isa, &mut NoUpstream, out, &mut []);
    }

    /// Gradient of the activated parameters of the region, `[P, region.height, region.width]`, written
    /// to `gradient`. `upstream` receives the forward result μ̂ of every block of pixels and answers
    /// with the gradient of the loss by it, so a loss needs one pass. μ̂ is written to `out`.
    ///
    /// # Panics
    /// As [`Self::forward`]; also when `gradient` has another length.
    pub fn backward<U: Upstream>(self, isa: Isa, upstream: &mut U, out: &mut [f32], gradient: &mut [f32]) {
        let Self { region, parameters, .. } = self;
        assert_eq!(gradient.len(), parameters.form.parameters() * region.pixels(), "gradient of the region");
        self.run(isa, upstream, out, gradient);
    }

    fn run<U: Upstream>(self, isa: Isa, upstream: &mut U, out: &mut [f32], gradient: &mut [f32]) {
        let Self { windows, taps, region, parameters } = self;
        if region.pixels() == 0 {
            return;
        }
        assert!(
            region.top + region.height <= windows.height() && region.left + region.width <= windows.width(),
            "region leaves the picture"
        );
        assert!(
            taps.radius() <= windows.radius(),
            "window of radius {} in planes padded by {}",
            taps.radius(),
            windows.radius()
        );
        assert_eq!(out.len(), 3 * region.pixels(), "corrected radiance of the region");
        parameters.check(&region);
        dispatch(isa, kernel::Correct { of: self, upstream, out, gradient });
    }
}
