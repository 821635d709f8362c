//! Runs one kernel on made-up values a number of times, so that instructions can be counted where times mean nothing, as
//! under an emulator: `kernel_counts PART TIMES [ISA]`, PART one of gc-forward, gc-backward (forward and backward),
//! network-forward, network-backward, of a tile of 48 x 48 pixels. The difference of two counts of TIMES is one run's. On
//! a processor of x86-64, of 64-bit Arm code:
//!
//! `qemu-aarch64-static -singlestep -d nochain,exec -L /usr/aarch64-linux-gnu kernel_counts gc-forward 1 2>&1 | grep -c ^Trace`

use fastrand::Rng;
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::{Correction, Given, PAPER_RADIUS, ParameterPlanes, Taps};
use sspc_kernels::network::{GradientPlanes, PackedNetwork, Shape, TilePlanes};
use sspc_kernels::parameters::{self, Form};
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::FeaturePlanes;
use std::sync::Arc;

/// Side of a tile, that of the preset `balanced`.
const TILE: usize = 48;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [part, times, ..] = &arguments[..] else { return Err("PART TIMES [ISA]".into()) };
    let times: usize = times.parse()?;
    let isa = arguments.get(2).map_or(Ok(Isa::best()), |name| Isa::named(name))?;
    let rng = &mut Rng::with_seed(1);
    let form = Form::Gated;
    let shape = Shape::shallow(form);
    let weights: Vec<f32> = (0..shape.parameter_count()).map(|_| 0.2 * rng.f32() - 0.1).collect();
    let pixels = TILE * TILE;
    let input: Vec<f32> = (0..FEATURE_CHANNELS * pixels).map(|_| rng.f32()).collect();
    if part.starts_with("gc") {
        let features = Image::from_planes(FEATURE_CHANNELS, TILE, TILE, input);
        let region = Region::whole(TILE, TILE);
        let windows = FeaturePlanes::new(Arc::new(features), None, FeatureSet::ALL, PAPER_RADIUS);
        let windows = windows.windows(region, Vec::new());
        let taps = Taps::square(PAPER_RADIUS);
        let mut values: Vec<f32> = (0..form.parameters() * pixels).map(|_| rng.f32()).collect();
        parameters::activate(isa, form, &mut values);
        let parameters = ParameterPlanes::of_region(form, &values, &region);
        let correction = Correction { windows: &windows, taps: &taps, region, parameters };
        let (mut out, mut gradient) = (vec![0.0; 3 * pixels], vec![0.0; values.len()]);
        let ones = vec![1.0; 3 * pixels];
        for _ in 0..times {
            match part.as_str() {
                "gc-forward" => correction.forward(isa, &mut out),
                "gc-backward" => correction.backward(isa, &mut Given::new(&ones, region), &mut out, &mut gradient),
                _ => return Err(format!("{part}: no such part").into()),
            }
        }
    } else {
        let network = PackedNetwork::new(isa, shape, &weights);
        let mut planes = TilePlanes::new(&shape, TILE, TILE);
        let mut back = GradientPlanes::of(&planes);
        let mut out = vec![0.0; shape.outputs * pixels];
        let mut by_weights = vec![0.0; weights.len()];
        for _ in 0..times {
            match part.as_str() {
                "network-forward" => network.forward(&mut planes, &input, &mut out),
                "network-backward" => network.backward(&planes, &mut back, &out, &mut by_weights),
                _ => return Err(format!("{part}: no such part").into()),
            }
        }
    }
    println!("{part}, {} tiles of {pixels} pixels, {}", times, isa.name());
    Ok(())
}
