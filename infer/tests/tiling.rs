//! The tiling does not show, and the kernels agree with the f64 network and with tract's own.

use sspc_core::tiles::{PictureTile, TileGrid};
use sspc_image::Image;
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::network;
use sspc_kernels::parameters::{Form, activation_f64};
use sspc_kernels::simd::Isa;
use sspc_testkit::closeness::assert_images_close;
use sspc_testkit::method::parameters;
use sspc_testkit::models::{features, model, next};

/// Nine layers of f32 sums of 144 terms each, then activations of slope <= 1 relative to their
/// value: measured 3e-6, with room for other machines.
const NETWORK_TOLERANCE: f64 = 1e-4;

#[test]
fn any_tile_size_gives_the_same_bits() {
    let model = model(Form::Gated, 16, 9);
    let mut state = 3;
    let mut upto = |n: usize| 1 + (next(&mut state) * n as f32) as usize;
    for isa in Isa::available() {
        for _ in 0..12 {
            let (height, width, tile) = (upto(70), upto(70), upto(40));
            let features = features(height, width);
            let run = |tile| parameters(&Engine::new(model.clone(), Kernels::Fused(isa), tile), &features);
            let (whole, tiled) = (run(height.max(width)), run(tile));
            assert!(whole == tiled, "{height}x{width} in tiles of {tile} on {}", isa.name());
        }
    }
}

#[test]
fn tracts_own_operators_give_the_same_tiled_and_whole() {
    let model = model(Form::Paper, 16, 9);
    for (height, width, tile) in [(45, 33, 17), (20, 64, 32), (7, 5, 3), (1, 40, 8)] {
        let features = features(height, width);
        let run = |kernels, tile| parameters(&Engine::new(model.clone(), kernels, tile), &features);
        let (tract, whole) = (run(Kernels::Tract, tile), run(Kernels::Tract, 64));
        let ours = run(Kernels::Fused(Isa::best()), tile);
        assert_images_close(&tract, &whole, NETWORK_TOLERANCE, &format!("{height}x{width} by {tile}"));
        assert_images_close(&ours, &whole, NETWORK_TOLERANCE, &format!("{height}x{width} fused"));
    }
}

#[test]
fn the_engine_agrees_with_the_f64_network() {
    for form in [Form::Paper, Form::Gated] {
        let model = model(form, 16, 9);
        let (height, width) = (13, 21);
        let features = features(height, width);
        let wide = |values: &[f32]| values.iter().map(|&v| f64::from(v)).collect::<Vec<_>>();
        let (weights, input) = (wide(&model.weights), wide(features.data()));
        let layers = network::oracle::forward(&model.contract.shape, &weights, &input, height, width);
        let raw = layers.last().unwrap();
        let pixels = height * width;
        let activated = raw.iter().enumerate().map(|(i, o)| activation_f64(i / pixels, *o).0 as f32);
        let expected = Image::from_planes(form.parameters(), height, width, activated.collect());
        for isa in Isa::available() {
            let engine = Engine::new(model.clone(), Kernels::Fused(isa), 6);
            let found = parameters(&engine, &features);
            assert_images_close(&found, &expected, NETWORK_TOLERANCE, isa.name());
        }
    }
}

#[test]
fn tiles_cover_every_pixel_once_and_windows_stay_inside() {
    for (height, width, tile, halo) in [(1, 1, 1, 9), (100, 37, 16, 9), (64, 64, 64, 9), (19, 300, 7, 2)] {
        let grid = TileGrid::new(height, width, tile, halo);
        let mut seen = vec![0; height * width];
        for PictureTile { region: t, window } in grid.tiles_of_rows(0..height) {
            assert!(window.top + window.height <= height && window.left + window.width <= width);
            let clear = |start: usize, end: usize, from: usize, to: usize, size: usize| {
                (from == 0 || start >= from + halo) && (to == size || end + halo <= to)
            };
            assert!(clear(t.top, t.top + t.height, window.top, window.top + window.height, height));
            assert!(clear(t.left, t.left + t.width, window.left, window.left + window.width, width));
            for y in t.top..t.top + t.height {
                for x in t.left..t.left + t.width {
                    seen[y * width + x] += 1;
                }
            }
        }
        assert!(seen.iter().all(|&n| n == 1), "{height}x{width} by {tile}");
    }
}
