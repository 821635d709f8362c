//! The post-correction function g_c (Eq. 10) with its cross-bilateral weights (Eq. 11), forward and
//! backward, for rectangles of a picture.
//!
//! [`forward`] and [`backward`] are thin: the arithmetic stands once, in [`kernel`] and what it calls,
//! generic over the instruction set; its naive f64 twin is [`oracle`].

mod kernel;
pub mod oracle;
mod pairs;
mod result;
mod strip;
mod sweep;
mod taps;

pub(crate) use kernel::load_lanes;
pub use kernel::{NoUpstream, Upstream};
pub use taps::Taps;

use crate::features::Windows;
use crate::parameters::Form;
use crate::simd::{Isa, dispatch};

/// Radius of the paper's window Ω_c: 19 x 19 pixels.
pub const PAPER_RADIUS: usize = 9;
/// Smallest Σw.
pub const WEIGHT_FLOOR: f32 = 1e-5;

/// A rectangle of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Region {
    pub top: usize,
    pub left: usize,
    pub height: usize,
    pub width: usize,
}

impl Region {
    /// The whole of a picture.
    pub fn whole(windows: &Windows) -> Self {
        Self { top: 0, left: 0, height: windows.height(), width: windows.width() }
    }

    pub fn pixels(&self) -> usize {
        self.height * self.width
    }

    /// As large, at the first pixel: a region in windows that are its own.
    pub fn at_origin(self) -> Self {
        Self { top: 0, left: 0, ..self }
    }
}

/// Activated parameters of a region: `plane` floats from one parameter to the next, rows of the
/// region `row` floats apart from `start` on.
#[derive(Clone, Copy, Debug)]
pub struct ParameterPlanes<'a> {
    pub form: Form,
    pub values: &'a [f32],
    pub start: usize,
    pub plane: usize,
    pub row: usize,
}

impl<'a> ParameterPlanes<'a> {
    /// Parameters `[P, region.height, region.width]` of one region alone.
    pub fn of_region(form: Form, values: &'a [f32], region: &Region) -> Self {
        Self { form, values, start: 0, plane: region.pixels(), row: region.width }
    }

    /// The part of a whole picture's parameters `[P, H, W]` that belongs to `region`.
    pub fn of_picture(form: Form, values: &'a [f32], windows: &Windows, region: &Region) -> Self {
        Self {
            form,
            values,
            start: region.top * windows.width() + region.left,
            plane: windows.height() * windows.width(),
            row: windows.width(),
        }
    }

    fn check(&self, region: &Region) {
        let last =
            self.start + (self.form.parameters() - 1) * self.plane + (region.height - 1) * self.row + region.width;
        assert!(last <= self.values.len() && region.width <= self.row, "parameters cover the region");
    }
}

/// Corrected radiance μ̂ of a region, `[3, region.height, region.width]`: g_c in the paper's form,
/// z + s (g_c - z) in the gated form.
///
/// # Panics
/// When the region leaves the picture, or the parameters do not cover it.
pub fn forward(isa: Isa, windows: &Windows, taps: &Taps, region: Region, parameters: ParameterPlanes, out: &mut [f32]) {
    run(isa, windows, taps, region, parameters, &mut NoUpstream, out, &mut []);
}

/// Gradient of the activated parameters of a region, `[P, region.height, region.width]`, written
/// to `gradient`. `upstream` receives the forward result μ̂ of every block of pixels and answers
/// with the gradient of the loss by it, so a loss needs one pass. μ̂ is written to `out`.
///
/// # Panics
/// As [`forward`]; also when `gradient` has another length.
pub fn backward<U: Upstream>(
    isa: Isa,
    windows: &Windows,
    taps: &Taps,
    region: Region,
    parameters: ParameterPlanes,
    upstream: &mut U,
    out: &mut [f32],
    gradient: &mut [f32],
) {
    assert_eq!(gradient.len(), parameters.form.parameters() * region.pixels(), "gradient of the region");
    run(isa, windows, taps, region, parameters, upstream, out, gradient);
}

fn run<U: Upstream>(
    isa: Isa,
    windows: &Windows,
    taps: &Taps,
    region: Region,
    parameters: ParameterPlanes,
    upstream: &mut U,
    out: &mut [f32],
    gradient: &mut [f32],
) {
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
    dispatch(isa, kernel::Correct { windows, taps, region, parameters, upstream, out, gradient });
}
