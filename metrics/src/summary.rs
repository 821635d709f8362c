//! All figures of one picture against its reference.

use crate::displayed::Displayed;
use crate::relative::{brightness, rel_l2, smape};
use serde::Serialize;
use sspc_image::{Image, Reference};

/// What `evaluate` reports of one picture. Non-finite figures are `null` in JSON.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// [`rel_l2`], without the reference's own noise where it has halves.
    pub rel_l2: f64,
    /// Standard error of `rel_l2` over pixels taken as independent.
    pub rel_l2_standard_error: f64,
    /// [`brightness`]: 1 if no energy is lost or added.
    pub brightness: f64,
    /// [`smape`], 0..2.
    pub smape: f64,
    /// Of the displayed picture, dB; infinite for equal pictures.
    pub psnr: f64,
    /// Of the displayed luma, -1..1.
    pub ssim: f64,
    /// Of the displayed picture, 0..1.
    pub flip: f64,
    /// Pixels measured.
    pub pixels: u64,
    /// Pixels left out because they are NaN or infinite.
    pub excluded: u64,
}

/// Measures `[3, H, W]` radiance against a reference; `exposure` is for the displayed figures.
///
/// # Panics
/// When the images do not have one shape of 3 channels.
pub fn figures(image: &Image, reference: &Reference, exposure: f32) -> Figures {
    let relative = rel_l2(image, reference);
    let displayed = Displayed::new(image, &reference.mean, exposure);
    Figures {
        rel_l2: relative.value,
        rel_l2_standard_error: relative.standard_error,
        brightness: brightness(image, &reference.mean),
        smape: smape(image, reference).value,
        psnr: displayed.psnr(),
        ssim: displayed.ssim(),
        flip: displayed.flip(),
        pixels: relative.pixels,
        excluded: relative.excluded,
    }
}
