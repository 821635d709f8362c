//! What each ring of the window Ω_c adds to a corrected frame: would a smaller window do?
//!
//!     cargo run --release --workspace --example window_rings -- MODEL.onnx A.exr B.exr [CHANGE]
//!
//! A ring is the pixels at one distance max(|dx|, |dy|) from the centre. Printed are the share of Σw in
//! every ring (mean and quantiles over the pixels of half a), and, for blocks of 16 x 8 pixels, the
//! smallest radius whose g_c changes no pixel of the block by more than CHANGE (default 1e-3) of
//! √(z̄² + 0.01), the scale of the relative error.

use rayon::prelude::*;
use sspc_core::objective::RELATIVE_FLOOR;
use sspc_core::plan::{BLOCK_COLUMNS, BLOCK_ROWS};
use sspc_core::prepare::{FrameStats, Prepared};
use sspc_core::tiles::parameters;
use sspc_frames::{FrameFiles, RoleOverrides};
use sspc_image::Image;
use sspc_kernels::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, NORMAL, RADIANCE, VISIBILITY};
use sspc_kernels::gc::WEIGHT_FLOOR;
use sspc_kernels::network::WindowNetwork;
use sspc_kernels::parameters::{BANDWIDTHS, CENTRE, Form, GATE, SLOPES};
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_testkit::frames::read_frame;
use std::path::PathBuf;

/// Quantiles over the pixels.
const QUANTILES: [f64; 5] = [0.05, 0.25, 0.5, 0.75, 0.95];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [model, a, b, rest @ ..] = arguments.as_slice() else {
        return Err("expected MODEL.onnx A.exr B.exr [CHANGE]".into());
    };
    let limit: f64 = rest.first().map_or(Ok(1e-3), |text| text.parse())?;
    let model = sspc_onnx::load_model(&PathBuf::from(model))?;
    let contract = &model.contract;
    let frame = read_frame(&FrameFiles::halves(a, b), &RoleOverrides::none())?;
    let stats = FrameStats::of(&frame, contract.exposure).with_features_of(contract.features);
    let prepared = Prepared::by_stats(&frame, &stats);
    let features = &prepared.halves[0];
    let network = WindowNetwork::new(Isa::best(), contract.form, &model.networks()[0]);
    let Ok(planes) = parameters(&network, 0, features, &prepared.plan, 0..prepared.height());
    let radius = contract.window_radius;
    let windows = Windows::new(features, prepared.valid.as_ref(), prepared.set, radius);
    let rows: Vec<Vec<Pixel>> = (0..prepared.height())
        .into_par_iter()
        .map(|y| (0..prepared.width()).map(|x| Pixel::of(&windows, contract.form, &planes, y, x, radius)).collect())
        .collect();
    print_shares(&rows, radius);
    print_blocks(&rows, &prepared, radius, limit);
    Ok(())
}

/// What the window of one pixel gives, ring by ring; ring 0 is the centre.
struct Pixel {
    /// Share of Σw in every ring.
    shares: Vec<f64>,
    /// Largest relative change of a channel of μ̂ when the window ends at this ring.
    change: Vec<f64>,
}

impl Pixel {
    fn of(windows: &Windows, form: Form, planes: &Image, y: usize, x: usize, radius: usize) -> Pixel {
        let p: Vec<f64> = (0..form.parameters()).map(|k| f64::from(planes.at(k, y, x))).collect();
        let at = |c: usize, dy: isize, dx: isize| f64::from(windows.at(c, y as isize + dy, x as isize + dx));
        let differences = |c: usize, dy, dx| [0, 1, 2].map(|k| at(c + k, 0, 0) - at(c + k, dy, dx));
        let valid = |dy, dx| if windows.masked() { at(FEATURE_CHANNELS, dy, dx) } else { 1.0 };
        let square = |d: [f64; 3]| d.iter().map(|v| v * v).sum::<f64>();
        let mut weight = vec![0.0; radius + 1];
        let mut sums = vec![[0.0; 3]; radius + 1];
        let r = radius as isize;
        for (dy, dx) in (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dy, dx))) {
            let slopes = [DENOISED, ALBEDO, NORMAL].map(|c| differences(c, dy, dx));
            let w = valid(dy, dx)
                * if (dy, dx) == (0, 0) {
                    p[CENTRE]
                } else {
                    let distances = [
                        square(slopes[1]),
                        square(slopes[2]),
                        (at(VISIBILITY, 0, 0) - at(VISIBILITY, dy, dx)).powi(2),
                        square(differences(RADIANCE, dy, dx)).ln_1p(),
                        square(slopes[0]).ln_1p(),
                    ];
                    (-distances.iter().zip(&p[BANDWIDTHS..]).map(|(d, gamma)| d * gamma).sum::<f64>()).exp()
                };
            let ring = dy.unsigned_abs().max(dx.unsigned_abs());
            weight[ring] += w;
            for k in 0..3 {
                let sloped: f64 = (0..3).map(|f| p[SLOPES + 3 * f + k] * slopes[f][k]).sum();
                sums[ring][k] += w * (at(RADIANCE + k, dy, dx) + sloped);
            }
        }
        let gate = if form == Form::Gated { p[GATE] } else { 1.0 };
        let scale =
            ((0..3).map(|k| at(DENOISED + k, 0, 0) / 3.0).sum::<f64>().powi(2) + f64::from(RELATIVE_FLOOR)).sqrt();
        let corrected = |last: usize| -> [f64; 3] {
            let total: f64 = weight[..=last].iter().sum();
            [0, 1, 2].map(|k| sums[..=last].iter().map(|s| s[k]).sum::<f64>() / total.max(f64::from(WEIGHT_FLOOR)))
        };
        let whole = corrected(radius);
        let change = |last: usize| {
            let part = corrected(last);
            (0..3).map(|k| gate * (part[k] - whole[k]).abs() / scale).fold(0.0, f64::max)
        };
        let total: f64 = weight.iter().sum::<f64>().max(f64::from(WEIGHT_FLOOR));
        Pixel { change: (0..=radius).map(change).collect(), shares: weight.iter().map(|w| w / total).collect() }
    }
}

fn print_shares(rows: &[Vec<Pixel>], radius: usize) {
    println!(
        "| ring | share of the taps | share of Σw: mean | {} |",
        QUANTILES.map(|q| format!("{:.0} %", 100.0 * q)).join(" | ")
    );
    println!("|{}", "---|".repeat(3 + QUANTILES.len()));
    let taps = ((2 * radius + 1) * (2 * radius + 1)) as f64;
    for ring in 0..=radius {
        let mut shares: Vec<f64> = rows.iter().flatten().map(|p| p.shares[ring]).collect();
        let mean = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
        shares.sort_by(f64::total_cmp);
        let of_taps = if ring == 0 { 1.0 } else { (8 * ring) as f64 } / taps;
        let quantiles = QUANTILES.map(|q| format!("{:.4}", shares[((shares.len() - 1) as f64 * q) as usize]));
        println!("| {ring} | {of_taps:.3} | {mean:.4} | {} |", quantiles.join(" | "));
    }
}

fn print_blocks(rows: &[Vec<Pixel>], prepared: &Prepared, radius: usize, limit: f64) {
    let blocks = prepared.plan.active_blocks();
    let mut count = vec![0usize; radius + 1];
    for block in &blocks {
        let pixels =
            || rows[block.top..block.top + block.height].iter().flat_map(|r| &r[block.left..block.left + block.width]);
        let enough = (0..=radius).find(|&last| pixels().all(|p| p.change[last] <= limit)).unwrap_or(radius);
        count[enough] += 1;
    }
    let mut pixels = vec![0usize; radius + 1];
    for p in rows.iter().flatten() {
        pixels[(0..=radius).find(|&last| p.change[last] <= limit).unwrap_or(radius)] += 1;
    }
    let total: usize = pixels.iter().sum();
    println!("\n| radius | blocks of {BLOCK_COLUMNS} x {BLOCK_ROWS} it is enough for | pixels |\n|---|---|---|");
    for last in 0..=radius {
        let share = |n: &[usize], of: usize| 100.0 * n[..=last].iter().sum::<usize>() as f64 / of.max(1) as f64;
        println!("| {last} | {:.1} % | {:.1} % |", share(&count, blocks.len()), share(&pixels, total));
    }
    let taps = |r: usize| ((2 * r + 1) * (2 * r + 1)) as f64;
    let work: f64 =
        (0..=radius).map(|r| count[r] as f64 * taps(r)).sum::<f64>() / (blocks.len().max(1) as f64 * taps(radius));
    println!("\nTaps with the smallest radius of every block: {:.1} % of all (change at most {limit:e})", 100.0 * work);
}
