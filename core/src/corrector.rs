//! From network to picture: parameters of every pixel, and g_c over the whole picture.

use crate::features::{DENOISED, Windows};
use crate::gc::{self, ParameterPlanes, Region, Taps};
use crate::image::Image;
use crate::network::{Network, WindowNetwork};
use crate::parameters::Form;
use crate::plan::Plan;
use crate::simd::Isa;
use rayon::prelude::*;

/// Activated parameters `[P, H, W]` of features `[13, H, W]`, where the plan computes anything.
///
/// # Panics
/// When the network's outputs are not the form's parameters.
pub fn parameters(isa: Isa, form: Form, network: &Network, features: &Image, plan: &Plan) -> Image {
    WindowNetwork::new(isa, form, network).run_picture(features, plan)
}

/// μ̂ of a picture, `[3, H, W]`, of activated `parameters` `[P, H, W]`; z of the windows where the plan
/// skips.
pub fn correct(isa: Isa, form: Form, windows: &Windows, taps: &Taps, parameters: &Image, plan: &Plan) -> Image {
    let (height, width) = (windows.height(), windows.width());
    let mut out = Image::from_fn(3, height, width, |k, y, x| windows.at(DENOISED + k, y as isize, x as isize));
    let parts: Vec<(Region, Vec<f32>)> = plan
        .runs()
        .into_par_iter()
        .map(|region| {
            let view = ParameterPlanes::of_picture(form, parameters.data(), windows, &region);
            let mut corrected = vec![0.0; 3 * region.pixels()];
            gc::forward(isa, windows, taps, region, view, &mut corrected);
            (region, corrected)
        })
        .collect();
    for (region, corrected) in parts {
        for (k, plane) in corrected.chunks_exact(region.pixels()).enumerate() {
            for (y, row) in plane.chunks_exact(region.width).enumerate() {
                let to = (region.top + y) * width + region.left;
                out.plane_mut(k)[to..to + region.width].copy_from_slice(row);
            }
        }
    }
    keep_finite(&mut out, windows);
    out
}

/// z where a correction is not finite: parameters from outside this program may be anything.
fn keep_finite(picture: &mut Image, windows: &Windows) {
    let (pixels, width) = (picture.pixels(), picture.width());
    for i in 0..pixels {
        if (0..3).any(|k| !picture.plane(k)[i].is_finite()) {
            let (y, x) = ((i / width) as isize, (i % width) as isize);
            (0..3).for_each(|k| picture.plane_mut(k)[i] = windows.at(DENOISED + k, y, x));
        }
    }
}
