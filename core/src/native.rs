//! The network over pictures of any size, by our own kernels: tiles on all threads.

use crate::plan::Plan;
use rayon::prelude::*;
use sspc_image::Image;
use sspc_kernels::network::WindowNetwork;
use sspc_kernels::region::Region;
use std::ops::Range;

/// Side of the windows that a picture is computed in, without their halo.
const PICTURE_WINDOW: usize = 128;

/// Activated parameters `[P, H, W]` of a picture's features `[13, H, W]`, zero in windows that the
/// plan skips. Windows have a halo of the network's radius; at the picture's border the zero
/// padding of every layer is exact, so the tiling does not show.
pub fn run_picture(network: &WindowNetwork, features: &Image, plan: &Plan) -> Image {
    run_rows(network, features, plan, 0..features.height())
}

/// The same for some `rows` of the picture, `[P, rows, W]`.
pub fn run_rows(network: &WindowNetwork, features: &Image, plan: &Plan, rows: Range<usize>) -> Image {
    let width = features.width();
    let windows: Vec<Region> = rows
        .clone()
        .step_by(PICTURE_WINDOW)
        .flat_map(|top| (0..width).step_by(PICTURE_WINDOW).map(move |left| (top, left)))
        .map(|(top, left)| Region {
            top,
            left,
            height: PICTURE_WINDOW.min(rows.end - top),
            width: PICTURE_WINDOW.min(width - left),
        })
        .filter(|window| plan.touches(window))
        .collect();
    let tiles: Vec<Image> = windows.par_iter().map(|window| run_with_halo(network, features, window)).collect();
    let mut out = Image::zeros(network.shape().outputs, rows.len(), width);
    for (window, tile) in windows.iter().zip(&tiles) {
        for c in 0..network.shape().outputs {
            for (y, row) in tile.plane(c).chunks_exact(window.width).enumerate() {
                let to = (window.top - rows.start + y) * width + window.left;
                out.plane_mut(c)[to..to + window.width].copy_from_slice(row);
            }
        }
    }
    out
}

fn run_with_halo(network: &WindowNetwork, features: &Image, window: &Region) -> Image {
    let halo = network.shape().radius();
    let (top, left) = (window.top.saturating_sub(halo), window.left.saturating_sub(halo));
    let bottom = (window.top + window.height + halo).min(features.height());
    let right = (window.left + window.width + halo).min(features.width());
    let input = features.crop(top, left, bottom - top, right - left);
    let inner = Region { top: window.top - top, left: window.left - left, ..*window };
    let mut out = Image::zeros(network.shape().outputs, window.height, window.width);
    network.run_inner(input.data(), input.height(), input.width(), inner, out.data_mut());
    out
}
