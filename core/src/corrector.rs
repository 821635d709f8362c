//! From network to picture: parameters of every pixel, and g_c over the whole picture.

use crate::features::{DENOISED, Windows};
use crate::gc::{self, ParameterPlanes, Region, Taps};
use crate::image::Image;
use crate::network::{Network, WindowNetwork};
use crate::parameters::Form;
use crate::plan::{BLOCK_ROWS, Plan};
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
    let mut out = Image::zeros(3, height, width);
    if out.data().is_empty() {
        return out;
    }
    let runs = plan.runs();
    let [r, g, b] = out.planes_mut();
    let block_rows = r.par_chunks_mut(BLOCK_ROWS * width).zip(g.par_chunks_mut(BLOCK_ROWS * width));
    block_rows.zip(b.par_chunks_mut(BLOCK_ROWS * width)).enumerate().for_each_init(
        Vec::new,
        |scratch, (block, rows)| {
            let mut rows = [rows.0.0, rows.0.1, rows.1];
            let top = block * BLOCK_ROWS;
            rows.iter_mut().enumerate().for_each(|(k, rows)| denoised_rows(windows, k, top, rows));
            let first = runs.partition_point(|run| run.top < top);
            for region in runs[first..].iter().take_while(|run| run.top == top) {
                let view = ParameterPlanes::of_picture(form, parameters.data(), windows, region);
                scratch.resize(3 * region.pixels(), 0.0);
                gc::forward(isa, windows, taps, *region, view, scratch);
                put(region, scratch, width, &mut rows);
            }
        },
    );
    out
}

/// z of the windows, rows from `top` on.
fn denoised_rows(windows: &Windows, k: usize, top: usize, rows: &mut [f32]) {
    for (y, row) in rows.chunks_exact_mut(windows.width()).enumerate() {
        let from = (DENOISED + k) * windows.plane() + windows.offset(top + y, 0);
        row.copy_from_slice(&windows.data()[from..from + windows.width()]);
    }
}

/// Puts a corrected region into the rows that begin where it does. Where a correction is not finite z
/// stays: parameters from outside this program may be anything.
fn put(region: &Region, corrected: &[f32], width: usize, rows: &mut [&mut [f32]; 3]) {
    for i in 0..region.pixels() {
        let value: [f32; 3] = std::array::from_fn(|k| corrected[k * region.pixels() + i]);
        if value.iter().all(|v| v.is_finite()) {
            let at = i / region.width * width + region.left + i % region.width;
            (0..3).for_each(|k| rows[k][at] = value[k]);
        }
    }
}
