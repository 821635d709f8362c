//! From network to picture: parameters of every pixel, and g_c over the whole picture.

use crate::gc::{self, ParameterPlanes, Region, Taps};
use crate::features::Windows;
use crate::image::Image;
use crate::network::{self, Network};
use crate::parameters::{Form, activate_plane};
use crate::simd::Isa;
use rayon::prelude::*;

/// Activated parameters `[P, H, W]` of features `[13, H, W]`.
///
/// # Panics
/// When the network's outputs are not the form's parameters.
pub fn parameters(isa: Isa, form: Form, network: &Network, features: &Image) -> Image {
    assert_eq!(network.shape.outputs, form.parameters(), "one output per parameter");
    let mut planes = network::run(isa, network, features);
    let pixels = planes.pixels();
    planes.data_mut().par_chunks_mut(pixels).enumerate().for_each(|(c, plane)| {
        activate_plane(isa, c, plane);
    });
    planes
}

/// Rows that one task corrects.
const BAND: usize = 8;

/// μ̂ of a whole picture, `[3, H, W]`, of activated `parameters` `[P, H, W]`.
pub fn correct(isa: Isa, form: Form, windows: &Windows, taps: &Taps, parameters: &Image) -> Image {
    let (height, width) = (windows.height(), windows.width());
    let mut out = Image::zeros(3, height, width);
    let bands: Vec<(Region, Vec<f32>)> = (0..height)
        .into_par_iter()
        .step_by(BAND)
        .map(|top| {
            let region = Region { top, left: 0, height: BAND.min(height - top), width };
            let view = ParameterPlanes::of_picture(form, parameters.data(), windows, &region);
            let mut corrected = vec![0.0; 3 * region.pixels()];
            gc::forward(isa, windows, taps, region, view, &mut corrected);
            (region, corrected)
        })
        .collect();
    for (region, corrected) in bands {
        for (k, plane) in corrected.chunks_exact(region.pixels()).enumerate() {
            out.plane_mut(k)[region.top * width..][..region.pixels()].copy_from_slice(plane);
        }
    }
    out
}
