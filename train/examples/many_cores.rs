//! What many cores can gain: the tasks of a training step and of a correction, as the code divides them for each number of
//! threads, timed one by one on one thread: `many_cores [HEIGHT WIDTH]`.
//!
//! Work is the sum of all tasks; the longest chain is what must wait for one another, however many threads there are. No
//! machine can be faster than the chain, nor than the work divided by its threads. The gain is the work undivided over the
//! larger of both.

use sspc_core::compose::rows_at_once;
use sspc_core::corrector::Jobs;
use sspc_core::objective::{Objective, PixelLoss, Scratch, Tile, parts_of_tile};
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_core::tiles::{DEFAULT_TILE, TileGrid};
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::{Correction, Given, ParameterPlanes, Taps};
use sspc_kernels::network::{GradientPlanes, Network, PackedNetwork, TilePlanes, WindowNetwork, sum_in_order};
use sspc_kernels::parameters::activate;
use sspc_kernels::region::Region;
use sspc_kernels::simd::Isa;
use sspc_kernels::windows::Windows;
use sspc_testkit::frames::prepared;
use sspc_train::preset::{Preset, Settings};
use std::time::Instant;

const THREADS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
const REPEATS: usize = 9;

/// Milliseconds: the least of some runs.
fn time(mut work: impl FnMut()) -> f64 {
    let once = |_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64() * 1e3
    };
    (0..REPEATS).map(once).fold(f64::INFINITY, f64::min)
}

/// Tasks of a stage, of which each thread takes one after the other, and what comes before and after them alone.
#[derive(Clone, Copy, Debug, Default)]
struct Stage {
    work: f64,
    chain: f64,
}

impl Stage {
    fn alone(milliseconds: f64) -> Self {
        Self { work: milliseconds, chain: milliseconds }
    }

    /// Tasks that do not wait for one another.
    fn of(tasks: &[f64]) -> Self {
        Self { work: tasks.iter().sum(), chain: tasks.iter().copied().fold(0.0, f64::max) }
    }

    fn then(self, next: Self) -> Self {
        Self { work: self.work + next.work, chain: self.chain + next.chain }
    }

    fn print(self, threads: usize, tasks: usize, undivided: f64) {
        let Self { work, chain } = self;
        let gain = undivided / chain.max(work / threads as f64);
        println!("| {threads} | {tasks} | {work:.1} | {chain:.2} | {gain:.1} |");
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    rayon::ThreadPoolBuilder::new().num_threads(1).build_global()?;
    let sizes: Vec<usize> = std::env::args().skip(1).map(|size| size.parse()).collect::<Result<_, _>>()?;
    let [height, width] = sizes[..].try_into().unwrap_or([720, 1280]);
    println!("{}, milliseconds on one thread", Isa::best().name());
    for preset in [Preset::Fast, Preset::Balanced] {
        step(preset);
    }
    correction(height, width);
    Ok(())
}

/// A training step of a preset.
fn step(preset: Preset) {
    let Settings { shape, form, radius, tile, batch, seed, .. } = Settings::of(preset, 1);
    let isa = Isa::best();
    let mut rng = Rng::new(seed);
    let frame = prepared([0, 1].map(|_| Image::from_fn(FEATURE_CHANNELS, 200, 300, |_, _, _| rng.uniform())));
    let objective = Objective::new(&frame, form, Taps::square(radius), FeatureSet::ALL).with_own_weight(&frame);
    let region = Region { top: 60, left: 90, height: tile, width: tile };
    let (one, pixels) = (Tile::upright(0, region), region.pixels());
    let weights = start::analytic(shape, 0.7, &mut rng).weights;

    println!("\na step of {preset}: {batch} tiles of {tile} x {tile}, windows of {0} x {0}", 2 * radius + 1);
    println!("| threads | tasks at once | work | longest chain | gain at most |\n|---|---|---|---|---|");
    let mut undivided = 0.0;
    for threads in THREADS {
        let parts = parts_of_tile(batch, threads);
        let mut features = Vec::new();
        let copy = time(|| {
            features.clear();
            objective.append_features(&one, &mut features);
        });
        let pack = time(|| drop(PackedNetwork::new(isa, shape, &weights)));
        let network = PackedNetwork::new(isa, shape, &weights).in_parts(parts);
        let mut planes = TilePlanes::new(&shape, tile, tile);
        let mut back = GradientPlanes::of(&planes);
        let mut outputs = vec![0.0; shape.outputs * pixels];
        let forward = time(|| network.forward(&mut planes, &features, &mut outputs));
        let mut gradient = outputs.clone();
        let mut by_weights = vec![0.0; weights.len()];
        let backward = time(|| network.backward(&planes, &mut back, &outputs, &mut by_weights));
        let measure = PixelLoss { scale: 1.0, influence: 1.0 };
        let mut scratch = Scratch::in_parts(parts);
        let mut loss = || {
            objective.loss(isa, &one, &outputs, measure, &mut gradient, &mut scratch);
        };
        let loss = time(&mut loss);
        // g_c of each part by itself; what else the loss does, one thread does.
        let mut parameters = outputs.clone();
        activate(isa, form, &mut parameters);
        let windows = objective.halves[0].planes.windows(region, Vec::new());
        let view = ParameterPlanes::of_region(form, &parameters, &region);
        let whole =
            Correction { windows: &windows, taps: &objective.taps, region: region.at_origin(), parameters: view };
        let cut = if parts > 1 { whole.in_parts(parts) } else { vec![whole] };
        let of_gc: Vec<f64> = cut
            .iter()
            .map(|part| {
                let pixels = part.region.pixels();
                let (mut out, mut by_outputs) = (vec![0.0; 3 * pixels], vec![0.0; form.parameters() * pixels]);
                let ones = vec![1.0; 3 * pixels];
                time(|| part.backward(isa, &mut Given::new(&ones, part.region.at_origin()), &mut out, &mut by_outputs))
            })
            .collect();
        let of_gc = Stage::of(&of_gc);
        // Rows and inputs are divided evenly, a layer waits for the last; copies are one thread's and small.
        let of_network = Stage { work: forward + backward, chain: (forward + backward) / parts as f64 };
        let alone = Stage::alone(copy + (loss - of_gc.work).max(0.0));
        let of_tile = alone.then(of_gc).then(of_network);
        let gradients = vec![by_weights.clone(); batch];
        let sum = time(|| drop(sum_in_order(&gradients)));
        let all = Stage { work: batch as f64 * of_tile.work, chain: of_tile.chain };
        let step = all.then(Stage::alone(pack + sum));
        if threads == 1 {
            undivided = step.work;
        }
        step.print(threads, batch * parts, undivided);
    }
}

/// Network and g_c of a picture, both halves and the full buffer's guides.
fn correction(height: usize, width: usize) {
    let Settings { shape, form, radius, seed, .. } = Settings::of(Preset::Balanced, 1);
    let isa = Isa::best();
    let mut rng = Rng::new(seed);
    let weights = start::analytic(shape, 0.7, &mut rng).weights;
    let features = Image::from_fn(FEATURE_CHANNELS, height, width, |_, _, _| rng.uniform());
    let window_network = WindowNetwork::new(isa, form, &Network { shape, weights });
    let grid = TileGrid::new(height, width, DEFAULT_TILE, shape.radius());
    let mut parameters = Image::zeros(shape.outputs, height, width);
    let mut of_tile = |tile: &sspc_core::tiles::PictureTile| {
        let mut out = Image::zeros(shape.outputs, tile.region.height, tile.region.width);
        let milliseconds = time(|| {
            let window = features.crop(tile.window.top, tile.window.left, tile.window.height, tile.window.width);
            window_network.run_inner(window.data(), window.height(), window.width(), tile.in_window(), out.data_mut());
        });
        parameters.put(tile.region.top, tile.region.left, &out);
        milliseconds
    };
    let of_network: Vec<(usize, f64)> =
        grid.tiles_of_rows(0..height).iter().map(|tile| (tile.region.top, of_tile(tile))).collect();
    let taps = Taps::square(radius);
    let windows = Windows::new(&features, None, FeatureSet::ALL, radius);
    let pad = time(|| drop(Windows::new(&features, None, FeatureSet::ALL, radius)));

    println!("\nnetwork and g_c of a picture of {width} x {height}, a model of balanced");
    println!("| threads | tasks at once | work | longest chain | gain at most |\n|---|---|---|---|---|");
    let mut undivided = 0.0;
    for threads in THREADS {
        let step = rows_at_once(form, width, DEFAULT_TILE, threads);
        let (mut all, mut most) = (Stage::default(), 0);
        for top in (0..height).step_by(step) {
            let rows = step.min(height - top);
            let Jobs { rows: of_job, by_strips } = Jobs::new(rows, width, threads);
            // Jobs are alike but for the last: one of each, timed.
            let region = Region { top, left: 0, height: of_job.min(rows), width };
            let view = ParameterPlanes::of_picture(form, parameters.data(), &windows, &region);
            let job = Correction { windows: &windows, taps: &taps, region, parameters: view };
            let cut = if by_strips { job.in_parts(1) } else { vec![job] };
            let mut of_gc = Vec::new();
            for part in cut {
                let mut out = vec![0.0; 3 * part.region.pixels()];
                let milliseconds = time(|| part.forward(isa, &mut out));
                of_gc.extend(vec![milliseconds; rows.div_ceil(of_job)]);
            }
            let tiles = of_network.iter().filter(|(of_tile, _)| (top..top + rows).contains(of_tile));
            let network: Vec<f64> = tiles.map(|(_, milliseconds)| *milliseconds).collect();
            most = most.max(network.len().min(of_gc.len()));
            // Padding is done by rows, of which there are thousands.
            let padding = Stage { work: pad * rows as f64 / height as f64, chain: 0.0 };
            let (network, gc) = (Stage::of(&network), padding.then(Stage::of(&of_gc)));
            // Halves one after the other: network, g_c with its own guides, g_c with the full buffer's.
            let of_half = network.then(gc).then(gc);
            all = all.then(of_half).then(of_half);
        }
        if threads == 1 {
            undivided = all.work;
        }
        all.print(threads, most, undivided);
    }
}
