//! Times the network by our kernels and by tract, and g_c, on made-up features:
//! `engine_speed FOLDER HEIGHT WIDTH [REPEATS]`. Prints one JSON object a line, least of the repeats, and leaves in
//! FOLDER network.onnx, rows.f32 and corrected.f32, parameters and g_c of some rows, for other engines to be compared
//! with. `bench/network` runs it beside onnxruntime and PyTorch.

use sspc_core::corrector::PictureCorrection;
use sspc_core::plan::Plan;
use sspc_core::tiles::{DEFAULT_TILE, parameters};
use sspc_image::Image;
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::Taps;
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::{Isa, Kernel, MAX_LANES, Simd, dispatch};
use sspc_kernels::windows::Windows;
use sspc_onnx::{Contract, Model, write_network};
use std::path::PathBuf;
use std::time::Instant;

/// Rows of the parameters that are written for comparison are this far apart.
const ROW_STEP: usize = 97;
/// Arithmetic of one tap of g_c (subtractions, products, polynomials, sums), counted in the kernel's source.
const FLOP_A_TAP: f64 = 123.0;

/// Processor time of this process so far (Linux; ticks of 10 ms): steadier than the clock on a
/// machine that does other things too.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.rsplit(')').next().unwrap_or("").split_whitespace().collect();
    let ticks = |i: usize| fields.get(i).and_then(|f| f.parse::<f64>().ok()).unwrap_or(f64::NAN);
    (ticks(11) + ticks(12)) / 100.0
}

/// Fused multiply-adds that wait for nothing: the most a core can do.
struct Peak(usize);

impl Kernel for Peak {
    type Output = f32;

    #[inline(always)]
    fn run<S: Simd>(self, s: S) -> f32 {
        const CHAINS: usize = 12;
        let (a, b) = (s.splat(0.999), s.splat(1e-3));
        let mut sums = [s.zero(); CHAINS];
        for (i, sum) in sums.iter_mut().enumerate() {
            *sum = s.splat(i as f32);
        }
        for _ in 0..self.0 {
            for sum in &mut sums {
                *sum = s.fma(*sum, a, b);
            }
        }
        let mut total = [0.0; MAX_LANES];
        s.store(&mut total, sums.into_iter().fold(s.zero(), |total, sum| s.add(total, sum)));
        total[0]
    }
}

impl Peak {
    fn flop(&self, isa: Isa) -> f64 {
        let lanes = if isa == Isa::Avx512 { 16.0 } else { 8.0 };
        2.0 * 12.0 * lanes * self.0 as f64
    }
}

/// Rows of every channel, as bytes.
fn some_rows(image: &Image) -> Vec<u8> {
    let rows = (0..image.height()).step_by(ROW_STEP).flat_map(|y| (0..image.channels()).map(move |c| (c, y)));
    rows.flat_map(|(c, y)| image.row(c, y)).flat_map(|v| v.to_le_bytes()).collect()
}

/// Prints what `work` takes, the least of the repeats in both measures.
fn report(name: &str, flop: f64, repeats: usize, mut work: impl FnMut()) {
    let (mut seconds, mut core_seconds) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..repeats {
        let (start, cpu) = (Instant::now(), cpu_seconds());
        work();
        seconds = seconds.min(start.elapsed().as_secs_f64());
        core_seconds = core_seconds.min(cpu_seconds() - cpu);
    }
    let line = serde_json::json!({
        "name": name, "seconds": seconds, "core_seconds": core_seconds, "gflop": flop * 1e-9,
    });
    println!("{line}");
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, height, width, ..] = &arguments[..] else { return Err("FOLDER HEIGHT WIDTH [REPEATS]".into()) };
    let (folder, height, width): (PathBuf, usize, usize) = (folder.into(), height.parse()?, width.parse()?);
    let repeats = arguments.get(3).map_or(Ok(3), |text| text.parse())?;
    let contract = Contract::new(Form::Gated);
    let count = contract.shape.parameter_count();
    let weights = (0..count).map(|i| ((i * 7919 + 13) % 1009) as f32 / 4036.0 - 0.125).collect();
    let model = Model::new(contract, weights)?;
    // The same formula as in bench/network.py.
    let features =
        Image::from_fn(FEATURE_CHANNELS, height, width, |c, y, x| ((c * 31 + y * 17 + x * 7) % 101) as f32 / 101.0);
    let everything = Plan::everything(height, width);
    let pixels = (height * width) as f64;
    let network_flop = 2.0 * count as f64 * pixels;

    let best = Isa::best();
    let peak = 40_000_000;
    report("peak of a core", Peak(peak).flop(best), repeats.max(3), || {
        std::hint::black_box(dispatch(best, Peak(peak)));
    });
    let mut kernels: Vec<(String, Kernels)> =
        Isa::available().into_iter().map(|isa| (format!("ours {}", isa.name()), Kernels::Fused(isa))).collect();
    kernels.push(("tract".into(), Kernels::Tract));
    for (name, kernels) in kernels {
        let engine = Engine::new(model.clone(), kernels, DEFAULT_TILE);
        let mut computed = None;
        report(&name, network_flop, repeats, || {
            computed = Some(parameters(&engine, 0, &features, &everything, 0..height).expect("the network runs"));
        });
        let Some(parameters) = computed else { continue };
        if kernels == Kernels::Fused(best) {
            std::fs::write(folder.join("network.onnx"), write_network(&model))?;
            std::fs::write(folder.join("rows.f32"), some_rows(&parameters))?;
            let taps = Taps::square(model.contract.window_radius);
            let windows = Windows::new(&features, None, FeatureSet::ALL, taps.radius());
            let side = (2 * taps.radius() + 1) as f64;
            let mut corrected = None;
            report("g_c of one half", FLOP_A_TAP * side * side * pixels, repeats, || {
                let runs = everything.runs();
                let of = PictureCorrection::of_one(best, Form::Gated, &windows, &taps, &parameters, &runs);
                corrected = Some(of.corrected().remove(0));
            });
            let Some(corrected) = corrected else { continue };
            std::fs::write(folder.join("corrected.f32"), some_rows(&corrected))?;
        }
    }
    Ok(())
}
