//! Times the network on made-up features: `network_speed HEIGHT WIDTH [REPEATS]`. Prints the best of
//! the repeats for every way to run it, and GFLOP/s of the picture's own pixels (halo not counted).
//! `RAYON_NUM_THREADS` sets the threads.

use sspc_core::corrector;
use sspc_core::features::FEATURE_CHANNELS;
use sspc_core::image::Image;
use sspc_core::parameters::Form;
use sspc_core::plan::Plan;
use sspc_core::simd::Isa;
use sspc_infer::engine::{Engine, Kernels};
use sspc_onnx::{Contract, Model};
use std::time::Instant;

/// Processor time of this process so far (Linux; ticks of 10 ms): steadier than the clock on a
/// machine that does other things too.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|f| f.parse::<f64>().ok()).unwrap_or(f64::NAN);
    (ticks(11) + ticks(12)) / 100.0
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<usize> = std::env::args().skip(1).map(|a| a.parse()).collect::<Result<_, _>>()?;
    let (height, width) = (arguments[0], arguments[1]);
    let repeats = arguments.get(2).copied().unwrap_or(3);
    let contract = Contract::new(Form::Gated);
    let count = contract.shape.parameter_count();
    let weights = (0..count).map(|i| ((i * 7919 + 13) % 1009) as f32 / 4036.0 - 0.125).collect();
    let model = Model::new(contract, weights)?;
    let features =
        Image::from_fn(FEATURE_CHANNELS, height, width, |c, y, x| ((c * 31 + y * 17 + x * 7) % 101) as f32 / 101.0);
    let everything = Plan::everything(height, width);
    let flop = 2.0 * count as f64 * (height * width) as f64;
    let report = |name: &str, work: &mut dyn FnMut()| {
        let (mut best, mut least) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..repeats {
            let (start, cpu) = (Instant::now(), cpu_seconds());
            work();
            best = best.min(start.elapsed().as_secs_f64());
            least = least.min(cpu_seconds() - cpu);
        }
        let rate = flop / least * 1e-9;
        println!("{name:<24} {best:.3} s, {least:.2} core-seconds, {rate:.1} GFLOP per core-second");
    };
    for isa in Isa::available() {
        for tile in [96, 128, 192, 256] {
            let engine = Engine::new(model.clone(), Kernels::Fused(isa), tile);
            report(&format!("fused {} tile {tile}", isa.name()), &mut || {
                engine.parameters(&features, &everything).expect("runs");
            });
        }
    }
    report("core alone", &mut || {
        corrector::parameters(Isa::best(), Form::Gated, &model.network(), &features, &everything);
    });
    for tile in [128, 256] {
        let engine = Engine::new(model.clone(), Kernels::Tract, tile);
        report(&format!("tract tile {tile}"), &mut || {
            engine.parameters(&features, &everything).expect("runs");
        });
    }
    Ok(())
}
