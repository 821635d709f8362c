//! What a corrected picture is shown and measured beside: noisy, denoised, reference.

use super::report::RelL2;
use crate::flicker::Measured;
use sspc_cli::reading::Source;
use sspc_core::prepare::baseline;
use sspc_core::same_scene::DifferentPlaces;
use sspc_frames::error::Error;
use sspc_frames::preview::{auto_exposure, spotlight, tone_map};
use sspc_image::{FrameRows, Image, Reference};
use sspc_metrics::rel_l2;
use sspc_metrics::relative::rel_l2_map;
use sspc_page::{FramePictures, Picture};

/// Rows that are read at a time.
const ROWS: usize = 64;

/// Whole pictures of a frame, `[3, H, W]` in its own units: 24 bytes per pixel, 60 with a reference that has halves.
pub struct Beside {
    noisy: Image,
    denoised: Image,
    /// Where the halves show different things, `[1, H, W]`.
    different: Option<Image>,
    reference: Option<Reference>,
}

impl Beside {
    /// Reads the pictures of a frame, band by band.
    ///
    /// # Errors
    /// What reading a file can raise.
    pub fn read(
        source: &Source,
        different: Option<&DifferentPlaces>,
        reference: Option<Reference>,
    ) -> Result<Self, Error> {
        let (height, width) = (source.height(), source.width());
        let (mut noisy, mut denoised) = (Image::zeros(3, height, width), Image::zeros(3, height, width));
        for top in (0..height).step_by(ROWS) {
            let rows = source.rows(top..(top + ROWS).min(height))?;
            noisy.put_rows(top, &rows.weights.mean_of(&rows.a.radiance, &rows.b.radiance));
            denoised.put_rows(top, &baseline(&rows));
        }
        Ok(Self { noisy, denoised, different: different.map(|places| places.map(height, width)), reference })
    }

    /// Whether there is one.
    pub fn has_reference(&self) -> bool {
        self.reference.is_some()
    }

    /// Errors against the reference, where there is one, of the finished picture too.
    pub fn rel_l2(&self, corrected: &Image) -> Option<RelL2> {
        self.reference.as_ref().map(|reference| RelL2 {
            noisy: rel_l2(&self.noisy, reference).value,
            denoised: rel_l2(&self.denoised, reference).value,
            corrected: rel_l2(corrected, reference).value,
            reference_noise_removed: reference.halves.is_some(),
        })
    }

    /// What is compared with the frame before, where there is a reference.
    pub fn measured<'a>(&'a self, corrected: &'a Image) -> Option<Measured<'a>> {
        let reference = self.reference.as_ref()?;
        Some(Measured { picture: corrected, denoised: Some(&self.denoised), reference })
    }

    /// All pictures to look at; `share` `[1, H, W]` is that of the correction that was used.
    pub fn pictures(&self, corrected: &Image, share: Option<&Image>) -> Vec<Picture> {
        let exposure = auto_exposure(&self.denoised);
        let reference = self.reference.as_ref().map(|reference| &reference.mean);
        let pictures = FramePictures {
            noisy: tone_map(&self.noisy, exposure),
            denoised: &self.denoised,
            corrected,
            reference,
            errors: reference.map(|r| [&self.denoised, corrected].map(|picture| rel_l2_map(picture, r))),
            share,
            different: self.different.as_ref().map(|places| spotlight(&self.denoised, places, exposure)),
            exposure,
        };
        pictures.pictures()
    }
}
