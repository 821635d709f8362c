//! Flicker of one step of a shot: the temporal error against references, along their estimated motion.

use serde::Serialize;
use sspc_image::{Image, Reference};
use sspc_metrics::temporal::Change;
use sspc_metrics::temporal_error;
use sspc_shots::field::{Field, composed};
use sspc_shots::flow::{Matchable, estimated};
use sspc_shots::validity::Guides;
use sspc_shots::warp::{Kernel, warped};

/// The way to the frame before and back must end this near its start, pixels: else something was covered or uncovered.
const NEAR: f32 = 1.0;

/// What is measured of a frame, `[3, H, W]` each.
#[derive(Clone, Copy)]
pub struct Measured<'a> {
    /// The finished picture.
    pub picture: &'a Image,
    /// The denoiser's, where it is there.
    pub denoised: Option<&'a Image>,
    /// What both are compared with.
    pub reference: &'a Reference,
}

/// The temporal error of one step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Flicker {
    /// Of the pictures.
    pub picture: f64,
    /// Of the denoiser's.
    pub denoised: Option<f64>,
    /// Share of the pixels that it is measured over.
    pub share: f64,
}

impl Flicker {
    /// From the frame `before` to the next, of the same size.
    ///
    /// # Panics
    /// When the pictures differ in size.
    pub fn of(now: Measured, before: Measured) -> Self {
        let field = way(&now.reference.mean, &before.reference.mean);
        let moved = |image: &Image| warped(image, &field, Kernel::CatmullRom);
        let reference = Reference {
            mean: moved(&before.reference.mean),
            halves: before.reference.halves.as_ref().map(|halves| halves.each_ref().map(moved)),
        };
        let of = |now_picture: &Image, before: &Image| {
            temporal_error(Change { now: now_picture, before: &moved(before) }, now.reference, &reference)
        };
        let picture = of(now.picture, before.picture);
        let denoised = now.denoised.zip(before.denoised).map(|(now, before)| of(now, before).value);
        let pixels = (picture.pixels + picture.excluded).max(1);
        Self { picture: picture.value, denoised, share: picture.pixels as f64 / pixels as f64 }
    }
}

/// From the pixels of one reference to those of the other: the same for every picture that is measured. NaN where the way
/// back does not end where it began.
fn way(now: &Image, before: &Image) -> Field {
    let [now, before] = [now, before].map(|image| Matchable::of(image, &Guides::default()));
    let field = estimated(&now, &before);
    let there_and_back = composed(&field, &estimated(&before, &now));
    Image::from_rows(2, field.height(), field.width(), |c, y, row| {
        let (right, down) = (there_and_back.row(0, y), there_and_back.row(1, y));
        for (x, (out, own)) in row.iter_mut().zip(field.row(c, y)).enumerate() {
            let is_near = right[x].hypot(down[x]) <= NEAR;
            *out = if is_near { *own } else { f32::NAN };
        }
    })
}
