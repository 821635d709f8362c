//! The post-correction function g_c (Eq. 10) with its cross-bilateral weights (Eq. 11), forward and
//! backward, for rectangles of a picture.
//!
//! [`Correction`] is thin: the arithmetic stands once, generic over the instruction set, in `kernel` and what it
//! calls, in the order of the data: `strip` copies rows of features close together, `pair_distances` computes
//! what the pixels of a pair share, `tap_sums` adds up the taps of every pixel, `from_sums` turns sums into μ̂ and
//! gradients; `means` averages further planes by the same weights. The naive f64 twin is [`oracle`].

mod from_sums;
mod given;
mod kernel;
mod means;
pub mod oracle;
mod pair_distances;
mod parameter_planes;
mod strip;
#[cfg(all(test, target_arch = "x86_64"))]
mod subnormals;
mod tap_sums;
mod taps;
mod vector;

pub use given::Given;
pub use kernel::{NoUpstream, Upstream};
pub use parameter_planes::ParameterPlanes;
pub use strip::STRIP;
pub use taps::Taps;

use crate::parts::in_parts;
use crate::region::Region;
use crate::simd::{Isa, dispatch};
use crate::windows::{PaddedPlanes, Windows};

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

/// One of several corrections of the same pixels.
#[derive(Clone, Copy)]
pub struct View<'a> {
    /// The noisy radiance.
    pub radiance: &'a Windows,
    /// All other features.
    pub guides: &'a Windows,
    /// The parameters of the region.
    pub parameters: ParameterPlanes<'a>,
}

/// Several g_c of the same pixels at once. What one has in common with the one before, the same windows of radiance or of
/// guides, is computed once; each is, bit for bit, what it is by itself.
#[derive(Clone)]
pub struct JointCorrection<'a> {
    /// Whose windows have one shape and one set of features.
    pub views: Vec<View<'a>>,
    /// The window Ω_c.
    pub taps: &'a Taps,
    /// Which pixels of the picture.
    pub region: Region,
}

impl JointCorrection<'_> {
    /// Corrected radiance μ̂ of the region by every view, `[views, 3, region.height, region.width]`.
    ///
    /// # Panics
    /// As [`Correction::forward`]; also when the windows of the views differ in shape or features.
    pub fn forward(self, isa: Isa, out: &mut [f32]) {
        self.run(isa, &mut NoUpstream, out, &mut []);
    }

    /// The same of a region that lies in this one.
    pub fn within(mut self, region: Region) -> Self {
        let (down, right) = (region.top - self.region.top, region.left - self.region.left);
        self.views.iter_mut().for_each(|view| view.parameters = view.parameters.offset_by(down, right));
        Self { region, ..self }
    }

    /// The region in at least `parts` parts, as [`Correction::in_parts`].
    pub fn in_parts(&self, parts: usize) -> Vec<Self> {
        parts_of(self.region, parts).into_iter().map(|region| self.clone().within(region)).collect()
    }

    fn run<U: Upstream>(self, isa: Isa, upstream: &mut U, out: &mut [f32], gradient: &mut [f32]) {
        let Self { views, taps, region } = &self;
        if region.pixels() == 0 || views.is_empty() {
            return;
        }
        let first = views[0].guides;
        for View { radiance, guides, parameters } in views {
            for windows in [radiance, guides] {
                check(windows, taps, region);
                assert!(windows.is_like(first), "windows of one shape and one set of features");
            }
            parameters.check(region);
        }
        assert_eq!(out.len(), views.len() * 3 * region.pixels(), "corrected radiance of the region");
        dispatch(isa, kernel::Correct { of: &self, upstream, out, gradient });
    }
}

/// Whether region and window lie in the picture.
fn check(windows: &Windows, taps: &Taps, region: &Region) {
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
}

/// A region in at least `parts` parts, strip by strip.
fn parts_of(region: Region, parts: usize) -> Vec<Region> {
    let strips = region.width.div_ceil(STRIP).max(1);
    let rows = in_parts(region.height, parts.div_ceil(strips));
    let lefts = (0..region.width).step_by(STRIP);
    let places = lefts.flat_map(|left| rows.iter().map(move |rows| (left, rows.clone())));
    let of_part = |(left, rows): (usize, std::ops::Range<usize>)| Region {
        top: region.top + rows.start,
        left: region.left + left,
        height: rows.len(),
        width: STRIP.min(region.width - left),
    };
    places.map(of_part).collect()
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

    /// Means of further planes of the same picture by g_c's weights, Σ w_i x_i / max(Σ w_i, 1e-5),
    /// `[planes, region.height, region.width]`: what g_c does to y when all slopes are zero.
    ///
    /// # Panics
    /// As [`Self::forward`]; also when the planes are of another size or padded by less than the window.
    pub fn means(self, isa: Isa, planes: &PaddedPlanes, out: &mut [f32]) {
        let Self { windows, taps, region, .. } = self;
        if region.pixels() == 0 || planes.count() == 0 {
            return;
        }
        self.check();
        assert_eq!((planes.height(), planes.width()), (windows.height(), windows.width()), "size of the planes");
        assert!(taps.radius() <= planes.radius(), "window of radius {} in planes", taps.radius());
        assert_eq!(out.len(), planes.count() * region.pixels(), "means of the region");
        dispatch(isa, means::Means { of: self, planes, out });
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

    /// The region in at least `parts` parts, where it has as many rows: in the order in which it is computed as a whole.
    /// Strips cost nothing, each part of a strip the rows around it.
    pub fn in_parts(self, parts: usize) -> Vec<Self> {
        let of_part = |region: Region| {
            let (down, right) = (region.top - self.region.top, region.left - self.region.left);
            Self { region, parameters: self.parameters.offset_by(down, right), ..self }
        };
        parts_of(self.region, parts).into_iter().map(of_part).collect()
    }

    fn run<U: Upstream>(self, isa: Isa, upstream: &mut U, out: &mut [f32], gradient: &mut [f32]) {
        let Self { windows, taps, region, parameters } = self;
        let views = vec![View { radiance: windows, guides: windows, parameters }];
        JointCorrection { views, taps, region }.run(isa, upstream, out, gradient);
    }

    /// Whether region, window and parameters lie in the picture.
    fn check(&self) {
        check(self.windows, self.taps, &self.region);
        self.parameters.check(&self.region);
    }
}
