//! The pictures of a frame in 8 bits, in the order of their keys, and what each is.

use serde::Serialize;
use sspc_core::LARGEST_SHARE;
use sspc_frames::preview::{Rgb8, error_map, share_map, tone_map};
use sspc_image::Image;

/// Label of the noisy picture.
pub const NOISY: &str = "noisy";

/// How the values of a picture became colours.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Scale {
    /// Radiance through the preview's tone curve: the page's exposure acts on it.
    Radiance,
    /// relL2 of each pixel, logarithmic ([`error_map`]).
    Error,
    /// 0..[`LARGEST_SHARE`], linear ([`share_map`]).
    Share,
}

/// One picture of a frame.
#[derive(Clone, Debug)]
pub struct Picture {
    /// What the page calls it.
    pub label: &'static str,
    /// What its colours mean.
    pub scale: Scale,
    /// Its pixels.
    pub pixels: Rgb8,
}

/// What a frame's pictures are made of: `[3, H, W]` in the frame's units, `share` `[1, H, W]`.
pub struct FramePictures<'a> {
    /// The mean of both halves' radiance, through the tone curve.
    pub noisy: Rgb8,
    /// The denoiser's picture.
    pub denoised: &'a Image,
    /// The finished picture.
    pub corrected: &'a Image,
    /// The reference's mean, where there is one.
    pub reference: Option<&'a Image>,
    /// relL2 `[1, H, W]` of denoised and corrected against the reference, where there is one.
    pub errors: Option<[Image; 2]>,
    /// Share of the correction that was used, 0..[`LARGEST_SHARE`].
    pub share: Option<&'a Image>,
    /// Where the halves show different things: everything else dimmed.
    pub different: Option<Rgb8>,
    /// Exposure of the tone curve.
    pub exposure: f32,
}

impl FramePictures<'_> {
    /// All of them; a picture's place is its key on the page.
    pub fn pictures(self) -> Vec<Picture> {
        let shown = |label, image| Picture { label, scale: Scale::Radiance, pixels: tone_map(image, self.exposure) };
        let mut all = vec![
            Picture { label: NOISY, scale: Scale::Radiance, pixels: self.noisy },
            shown("denoised", self.denoised),
            shown("corrected", self.corrected),
        ];
        all.extend(self.reference.map(|reference| shown("reference", reference)));
        if let Some(errors) = &self.errors {
            for (label, errors) in ["error, denoised", "error, corrected"].into_iter().zip(errors) {
                all.push(Picture { label, scale: Scale::Error, pixels: error_map(errors) });
            }
        }
        all.extend(self.share.map(|share| Picture {
            label: "share",
            scale: Scale::Share,
            pixels: share_map(share, LARGEST_SHARE),
        }));
        let different = |pixels| Picture { label: "halves differ", scale: Scale::Radiance, pixels };
        all.extend(self.different.map(different));
        all
    }
}
