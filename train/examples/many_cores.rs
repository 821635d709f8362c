//! What many cores can gain: the tasks of a training step and of a correction, as the code divides them for each number of
//! threads, counted in vector operations: `many_cores [HEIGHT WIDTH]`.
//!
//! Work is the sum of all tasks; the longest chain is what must wait for one another, however many threads there are. No
//! machine is faster than the chain, nor than the work divided by its threads: the gain at most is the work of one thread
//! over the larger of both. Reading, writing and what is done by rows, of which there are thousands, are left out.

use sspc_core::compose::parts_of_gc;
use sspc_core::objective::parts_of_tile;
use sspc_core::tiles::{DEFAULT_TILE, PictureTile, TileGrid};
use sspc_image::Image;
use sspc_kernels::features::{FEATURE_CHANNELS, FeatureSet};
use sspc_kernels::gc::{Correction, ParameterPlanes, Taps};
use sspc_kernels::network::{KERNEL, Shape};
use sspc_kernels::region::Region;
use sspc_kernels::windows::Windows;
use sspc_train::preset::{Preset, Settings};

const THREADS: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
/// Vector operations of g_c per tap, forward and with the gradient, and per pair of pixels (`kernels/src/gc/kernel.rs`).
const PER_TAP: [f64; 2] = [40.0, 75.0];
const PER_PAIR: f64 = 60.0;
/// Those of a pair that its radiance takes.
const PER_RADIANCE: f64 = 25.0;
/// Multiply-adds of a tile's convolutions over those of every tap, and operations per pixel and channel of what is multiplied
/// (`kernels/src/network/points.rs`): of inputs, of outputs and of their gradients.
const MULTIPLIED: f64 = 0.5;
const PER_INPUT: f64 = 3.0;
const PER_OUTPUT: f64 = 2.5;
const PER_GRADIENT: f64 = 2.0;
/// Rows that a tile's convolutions compute together.
const GROUP: usize = 4;
/// What one thread does for each pixel of a tile beside g_c and network: activations forward and backward, copies.
const PER_PIXEL: f64 = 1000.0;

/// Tasks one after the other: all of them, and the longest chain.
#[derive(Clone, Copy, Debug, Default)]
struct Stage {
    work: f64,
    chain: f64,
}

impl Stage {
    fn alone(operations: f64) -> Self {
        Self { work: operations, chain: operations }
    }

    /// Tasks that do not wait for one another.
    fn of(tasks: impl IntoIterator<Item = f64>) -> Self {
        let add = |sum: Self, task: f64| Self { work: sum.work + task, chain: sum.chain.max(task) };
        tasks.into_iter().fold(Self::default(), add)
    }

    fn then(self, next: Self) -> Self {
        Self { work: self.work + next.work, chain: self.chain + next.chain }
    }

    /// A row of the table.
    fn print(self, threads: usize, tasks: usize, of_one: f64) {
        let Self { work, chain } = self;
        let gain = of_one / chain.max(work / threads as f64);
        println!("| {threads} | {tasks} | {:.1} | {:.2} | {gain:.1} |", work / 1e6, chain / 1e6);
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let sizes: Vec<usize> = std::env::args().skip(1).map(|size| size.parse()).collect::<Result<_, _>>()?;
    let [height, width] = sizes[..].try_into().unwrap_or([720, 1280]);
    [Preset::Fast, Preset::Balanced].into_iter().for_each(step);
    correction(height, width);
    Ok(())
}

fn head() {
    println!("| threads | tasks at once | work, million operations | longest chain | gain at most |");
    println!("|---|---|---|---|---|");
}

/// A training step of a preset.
fn step(preset: Preset) {
    let Settings { shape, radius, tile, batch, .. } = Settings::of(preset, 1);
    println!("\na step of {preset}: {batch} tiles of {tile} x {tile}, windows of {0} x {0}\n", 2 * radius + 1);
    head();
    let pixels = (tile * tile) as f64;
    let mut of_one = 0.0;
    for threads in THREADS {
        let parts = parts_of_tile(batch, threads);
        let divided = with_regions(Region::whole(tile, tile), radius, |whole| match parts {
            1 => vec![whole.region],
            _ => whole.in_parts(parts).iter().map(|part| part.region).collect(),
        });
        let mut of_tile = Stage::alone(PER_PIXEL * pixels).then(Stage::of(divided.iter().map(|r| of_gc(r, radius, 1))));
        for l in 0..shape.layers {
            // Forward by groups of rows; weights by inputs, then the gradient of the inputs by groups of rows.
            let (inputs, outputs) = shape.channels(l);
            let multiplied = MULTIPLIED * of_layer(&shape, l);
            let per_pixel = multiplied + PER_INPUT * inputs as f64 + PER_OUTPUT * outputs as f64;
            let of_groups = |groups| per_pixel * (groups * GROUP * tile) as f64;
            let by_rows = Stage::of(shares(tile / GROUP, parts).map(of_groups));
            let points = Stage::alone((PER_INPUT * inputs as f64 + PER_GRADIENT * outputs as f64) * pixels);
            let by_inputs = Stage::of(shares(inputs, parts).map(|n| multiplied * pixels * n as f64 / inputs as f64));
            of_tile = of_tile.then(by_rows).then(points).then(by_inputs);
            of_tile = if l > 0 { of_tile.then(by_rows) } else { of_tile };
        }
        let step = Stage { work: batch as f64 * of_tile.work, chain: of_tile.chain };
        of_one = if threads == 1 { step.work } else { of_one };
        step.print(threads, batch * parts, of_one);
    }
}

/// Network and g_c of a picture with a model of `balanced`: tile by tile both halves, each with its own guides and with those
/// of the full buffer.
fn correction(height: usize, width: usize) {
    let Settings { shape, radius, .. } = Settings::of(Preset::Balanced, 1);
    println!("\nnetwork and g_c of a picture of {width} x {height}, a model of balanced\n");
    head();
    let tiles = TileGrid::new(height, width, DEFAULT_TILE, shape.radius()).tiles_of_rows(0..height);
    let of_network: f64 = (0..shape.layers).map(|l| of_layer(&shape, l)).sum();
    let mut of_one = 0.0;
    for threads in THREADS {
        let parts = parts_of_gc(tiles.len(), threads);
        let of_tile = |tile: &PictureTile| {
            let strips =
                with_regions(tile.region, radius, |job| job.in_parts(parts).iter().map(|part| part.region).collect());
            let network = Stage::of([of_network * tile.window.pixels() as f64; 2]);
            let gc = Stage::of(strips.iter().map(|region| of_views(region, radius)));
            (network.then(gc), strips.len().max(2))
        };
        let add = |(sum, count): (Stage, usize), (tile, tasks): (Stage, usize)| {
            (Stage { work: sum.work + tile.work, chain: sum.chain.max(tile.chain) }, count + tasks)
        };
        let (all, tasks) = tiles.iter().map(of_tile).fold((Stage::default(), 0), add);
        of_one = if threads == 1 { all.work } else { of_one };
        all.print(threads, tasks, of_one);
    }
}

/// What `divide` makes of g_c over a region: it reads the region alone.
fn with_regions(region: Region, radius: usize, divide: impl Fn(Correction) -> Vec<Region>) -> Vec<Region> {
    let windows = Windows::new(&Image::zeros(FEATURE_CHANNELS, 1, 1), None, FeatureSet::ALL, 1);
    let taps = Taps::square(radius);
    let form = Settings::of(Preset::Balanced, 1).form;
    let parameters = ParameterPlanes::of_region(form, &[], &region);
    divide(Correction { windows: &windows, taps: &taps, region, parameters })
}

/// Operations of g_c over a region, with its gradient where `pass` is 1.
fn of_gc(region: &Region, radius: usize, pass: usize) -> f64 {
    let (taps, pairs) = taps_and_pairs(region, radius);
    PER_TAP[pass] * taps + PER_PAIR * pairs
}

/// The same of both halves with their own guides and with those of the full buffer, which share some of the distances.
fn of_views(region: &Region, radius: usize) -> f64 {
    let (taps, pairs) = taps_and_pairs(region, radius);
    4.0 * PER_TAP[0] * taps + (2.0 * PER_RADIANCE + 3.0 * (PER_PAIR - PER_RADIANCE)) * pairs
}

/// Taps and pairs of pixels of a region: strips of their own, rows in pairs of which one may lie outside.
fn taps_and_pairs(region: &Region, radius: usize) -> (f64, f64) {
    let (height, width, r) = (region.height as isize, region.width as f64, radius as isize);
    let taps = region.pixels() as f64 * ((2 * radius + 1).pow(2) - 1) as f64;
    let strips = region.width.div_ceil(sspc_kernels::gc::STRIP) as f64;
    let inside = |y: isize| (0..height).contains(&y);
    let mut pairs = 0.0;
    for (upper, dy) in (-r..height).flat_map(|upper| (0..=r).map(move |dy| (upper, dy))) {
        for dx in if dy == 0 { 1..=r } else { -r..=r } {
            pairs += match (inside(upper), inside(upper + dy)) {
                (true, true) => width + strips * dx.abs() as f64,
                (false, false) => 0.0,
                _ => width,
            };
        }
    }
    (taps, pairs)
}

/// Multiply-adds of a layer per pixel.
fn of_layer(shape: &Shape, l: usize) -> f64 {
    let (inputs, outputs) = shape.channels(l);
    (inputs * outputs * KERNEL * KERNEL) as f64
}

/// How many of `count` each part has.
fn shares(count: usize, parts: usize) -> impl Iterator<Item = usize> {
    sspc_kernels::parts::in_parts(count, parts).into_iter().map(|range| range.len())
}
