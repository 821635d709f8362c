//! How fast the kernels run on one thread, under every instruction set, and that they are right
//! while they do: `cargo run --release -p sspc-kernels --example kernel_rates`.

use fastrand::Rng;
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::{self, Given, ParameterPlanes, Taps};
use sspc_kernels::network::{GradientPlanes, PackedNetwork, Shape, TilePlanes};
use sspc_kernels::parameters::{self, Form};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use std::time::Instant;

/// Seconds of the fastest of many runs: what the kernel can do while nobody else has the core.
fn seconds(mut f: impl FnMut()) -> f64 {
    (0..40)
        .map(|_| {
            let start = Instant::now();
            f();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

fn main() {
    /// Side of a tile, that of the preset `balanced`.
    const TILE: usize = 48;
    let rng = &mut Rng::with_seed(1);
    let shape = Shape::paper(Form::Gated);
    let weights: Vec<f32> = (0..shape.parameter_count()).map(|_| 0.2 * rng.f32() - 0.1).collect();
    let pixels = TILE * TILE;
    let input: Vec<f32> = (0..FEATURE_CHANNELS * pixels).map(|_| rng.f32()).collect();
    let image = Image::from_fn(FEATURE_CHANNELS, 64, 64, |_, _, _| rng.f32());
    let windows = Windows::new(&image, None, FeatureSet::ALL, gc::PAPER_RADIUS);
    let taps = Taps::square(gc::PAPER_RADIUS);
    let region = Region { top: 8, left: 8, height: TILE, width: TILE };
    let gflop = 2.0 * (shape.parameter_count() - 16 * shape.layers) as f64 * pixels as f64 * 1e-9;
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    println!("one thread; network in GFLOP/s, g_c in µs per pixel");
    let mut first: Option<(Vec<f32>, Vec<f32>)> = None;
    for isa in Isa::available() {
        pool.install(|| {
            // As in training, the planes of a tile are used again.
            let network = PackedNetwork::new(isa, shape, &weights);
            let mut planes = TilePlanes::new(&shape, TILE, TILE);
            let mut back = GradientPlanes::of(&planes);
            let mut out = vec![0.0; shape.outputs * pixels];
            let forward = seconds(|| network.forward(&mut planes, &input, &mut out));
            let mut by_weights = vec![0.0; weights.len()];
            let backward = seconds(|| network.backward(&planes, &mut back, &out, &mut by_weights));
            let mut p = out.clone();
            parameters::activate(isa, Form::Gated, &mut p);
            let view = ParameterPlanes::of_region(Form::Gated, &p, &region);
            let mut corrected = vec![0.0; 3 * region.pixels()];
            let mut gradient = vec![0.0; p.len()];
            let gc_forward = seconds(|| gc::forward(isa, &windows, &taps, region, view, &mut corrected));
            let ones = vec![1.0; 3 * region.pixels()];
            let gc_both = seconds(|| {
                let mut given = Given::new(&ones, region);
                gc::backward(isa, &windows, &taps, region, view, &mut given, &mut corrected, &mut gradient);
            });
            let micro = 1e6 / region.pixels() as f64;
            println!(
                "{:9} network forward {:6.1} backward {:6.1} | g_c forward {:.3} forward and backward {:.3}",
                isa.name(),
                gflop / forward,
                2.0 * gflop / backward,
                gc_forward * micro,
                gc_both * micro
            );
            let answer = (corrected, out);
            if let Some(first) = &first {
                let close =
                    |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(a, b)| (a - b).abs() <= 1e-4 * b.abs().max(1.0));
                assert!(close(&answer.0, &first.0) && close(&answer.1, &first.1), "{} disagrees", isa.name());
            } else {
                first = Some(answer);
            }
        });
    }
}
