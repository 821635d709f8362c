//! A picture beside the denoiser's, both against one reference.

use crate::relative::{Measured, rel_l2_gain};
use crate::summary::{Figures, figures};
use sspc_image::{Image, Reference};

/// The denoiser's figures, and what the picture's are of them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Comparison {
    /// The denoiser's.
    pub figures: Figures,
    /// relL2 of the picture over the denoiser's; NaN where the denoiser's is not above 0.
    pub rel_l2_ratio: f64,
    /// 1 - [`rel_l2_gain`] / the denoiser's relL2: the same ratio without what noise of the reference does to relL2; NaN
    /// where the reference has no halves.
    pub crossed_ratio: f64,
    /// Its standard error over pixels taken as independent.
    pub crossed_ratio_standard_error: f64,
}

impl Comparison {
    /// Measures the `denoised` picture beside `picture`, whose figures are `own`; all `[3, H, W]`.
    ///
    /// # Panics
    /// When the images do not have one shape of 3 channels.
    pub fn of(picture: &Image, own: &Figures, denoised: &Image, reference: &Reference, exposure: f32) -> Self {
        let figures = figures(denoised, reference, exposure);
        let none = Measured { value: f64::NAN, standard_error: f64::NAN, pixels: 0, excluded: 0 };
        let gain = rel_l2_gain(picture, denoised, reference).unwrap_or(none);
        let ratio = |own: f64, other: f64| if other > 0.0 { own / other } else { f64::NAN };
        Comparison {
            figures,
            rel_l2_ratio: ratio(own.rel_l2, figures.rel_l2),
            crossed_ratio: 1.0 - ratio(gain.value, figures.rel_l2),
            crossed_ratio_standard_error: ratio(gain.standard_error, figures.rel_l2),
        }
    }
}
