//! The post-correction function g_c (Eq. 10) with its cross-bilateral weights (Eq. 11), forward and
//! backward, for rectangles of a picture.
//!
//! [`forward`] and [`backward`] are thin: the arithmetic stands once, in [`kernel`] and what it calls,
//! generic over the instruction set; its naive f64 twin is [`oracle`].

mod given;
mod kernel;
pub mod oracle;
mod pairs;
mod parameter_planes;
mod result;
mod strip;
mod sweep;
mod taps;
mod vector;

pub use given::Given;
pub use kernel::{NoUpstream, Upstream};
pub use parameter_planes::ParameterPlanes;
pub use taps::Taps;
pub(crate) use vector::load_lanes;

use crate::region::Region;
use crate::simd::{Isa, dispatch};
use crate::windows::Windows;

/// Radius of the paper's window Ω_c: 19 x 19 pixels.
pub const PAPER_RADIUS: usize = 9;
/// Smallest Σw.
pub const WEIGHT_FLOOR: f32 = 1e-5;

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
