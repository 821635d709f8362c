//! The sums of g_c over the window in standard operators, in a form that is mostly matrix products.
//!
//! A tile of 4x4 pixels shares the pixels of its windows, its keys. With x relative to the least of the tile,
//! ‖x_c - x_i‖² = ‖x_c‖² - 2 x_c·x_i + ‖x_i‖² is one product of a matrix of the tile's pixels and one of its keys, and
//! so is the weighted sum of the keys' values. What is left for each pair are two logarithms, which take a third of the
//! time, an exponential and a few additions, multiplications and limits. y's logarithm serves the half's own guides and
//! the full buffer's, that of the full buffer's z both halves.
//!
//! Rounding must not make 1 + ‖x_c - x_i‖² less than 1 nor an exponent positive: limits see to that. Distances between
//! values far from 0 and far from the tile's least keep a rounding of their squares, 1e-7 of them.

use super::ops::Ops;
use crate::builder::{Dim, int, subgraph};
use crate::messages::{GraphProto, data_type};

/// Side of a tile, pixels: smaller ones gather more keys for each pixel, larger ones compute more pairs outside of
/// windows.
pub(super) const TILE: i64 = 4;
/// Tiles of a chunk, one below the other: enough work for each operator, not more than caches hold.
const CHUNK: i64 = 8;
/// Rows of a chunk.
pub(super) const CHUNK_ROWS: i64 = CHUNK * TILE;
/// Channels of the values: y, albedo, visibility, normal, z and the penalty of missing pixels.
pub(super) const VALUES: i64 = 14;
/// Sums of a pixel: of y, albedo, visibility, normal and z, each times the weight, and of the weight.
pub(super) const SUMS: i64 = 14;
/// How channels divide into y, features and z.
pub(super) const GROUPS: [i64; 3] = [3, 7, 3];
/// Exponent of a pair that does not count.
pub(super) const NEVER: f32 = -1e30;

/// Constants that all networks share: 1 for each key of a chunk, `[2, tiles, 1, keys]`, and [`NEVER`] for each key of a
/// pixel that its window leaves out, `[tile², keys]`.
pub(super) const ONES: &str = "ones";
pub(super) const BIAS: &str = "bias";

/// Adds the constants.
pub(super) fn add_constants(g: &mut Ops, radius: i64) {
    let keys = ((TILE + 2 * radius) * (TILE + 2 * radius)) as usize;
    let chunk = 2 * CHUNK as usize;
    g.graph.floats(ONES, &[2, chunk / 2, 1, keys], &vec![1.0; chunk * keys]);
    g.graph.floats(BIAS, &[(TILE * TILE) as usize, keys], &bias(radius));
}

/// What the sums are made of; pictures are padded to whole chunks below and whole tiles on the right.
pub(super) struct Pairs<'a> {
    /// For each guides: what is compared and averaged.
    pub guides: &'a [Values],
    /// Bandwidths of albedo, normal, visibility, y, z, `[2, 5, H, W]`.
    pub gamma: &'a str,
    /// Size of the padded picture, `[1]` each.
    pub height: &'a str,
    pub width: &'a str,
    pub radius: i64,
}

/// Values of both halves under one guides.
pub(super) struct Values {
    /// [`VALUES`] channels, mirrored around the borders, `[2, 14, H + 2 radius, W + 2 radius]`.
    pub keys: String,
    /// The pixels themselves, relative to the least of their tile, `[2, 13, H, W]`.
    pub pixels: String,
    /// The least of each tile, `[2, 13, H / 4, W / 4]`.
    pub least: String,
}

/// The sums `[2, 14, H, W]` under each guides, relative to the tile's least, without the pixel itself.
pub(super) fn window_sums(g: &mut Ops, pairs: &Pairs) -> Vec<String> {
    let mut scanned = vec![("start".to_string(), starts(g, pairs))];
    let gamma = g.split(pairs.gamma, &[1; 5], 1);
    let [rho, n, v, y, z] = &gamma[..] else { unreachable!("five bandwidths") };
    let of_features = g.concat(&[rho, rho, rho, v, n, n, n], 1);
    for (name, gamma) in [("gamma_y", y), ("gamma_z", z)] {
        scanned.push((name.into(), in_chunks(g, gamma, 1, pairs, TILE)));
    }
    for (i, values) in pairs.guides.iter().enumerate() {
        let least = in_chunks(g, &values.least, VALUES - 1, pairs, 1);
        scanned.push((format!("least_{i}"), g.transpose(&least, &[0, 1, 2, 4, 3])));
        let groups = g.split(&values.pixels, &GROUPS, 1);
        let (y, z) = (of_logarithm(g, &groups[0]), of_logarithm(g, &groups[2]));
        let f = of_exponent(g, &groups[1], &of_features);
        for (name, matrix, channels) in [("y", y, 7), ("f", f, 16), ("z", z, 7)] {
            // y is the half's own under all guides.
            if i == 0 || name != "y" {
                scanned.push((format!("{name}_{i}"), in_chunks(g, &matrix, channels, pairs, TILE)));
            }
        }
    }
    let names: Vec<&str> = scanned.iter().map(|(name, _)| name.as_str()).collect();
    let inputs: Vec<&str> = scanned.iter().map(|(_, value)| value.as_str()).collect();
    let with = vec![subgraph("body", body(&names, pairs)), int("num_scan_inputs", inputs.len() as i64)];
    let sums = g.several("Scan", &inputs, pairs.guides.len(), with);
    sums.iter().map(|sums| from_chunks(g, sums, pairs)).collect()
}

/// Row and column of every chunk's first key, `[chunks, 2]`.
fn starts(g: &mut Ops, pairs: &Pairs) -> String {
    let (down, across) = (g.range_of(pairs.height, CHUNK_ROWS, &[-1, 1]), g.range_of(pairs.width, TILE, &[1, -1]));
    let nothing = g.int(0);
    let (no_rows, no_columns) = (g.mul(&down, &nothing), g.mul(&across, &nothing));
    let (y, x) = (g.add(&down, &no_columns), g.add(&across, &no_rows));
    let [y, x] = [y, x].map(|at| g.reshape_to(&at, &[-1, 1]));
    g.concat(&[&y, &x], 1)
}

/// The pixels' side of 1 + ‖x_c - x_i‖²: -2 x, thrice 1 for the key's squares, 1 + ‖x‖².
fn of_logarithm(g: &mut Ops, x: &str) -> String {
    let (twice, none) = (g.times(x, -2.0), g.times(x, 0.0));
    let factor = g.add_to(&none, 1.0);
    let squared = g.reduce("ReduceSumSquare", x, &[1]);
    let constant = g.add_to(&squared, 1.0);
    g.concat(&[&twice, &factor, &constant], 1)
}

/// The pixels' side of -Σ γ (f_c - f_i)² and of the penalty.
fn of_exponent(g: &mut Ops, f: &str, gamma: &str) -> String {
    let by_gamma = g.mul(f, gamma);
    let (twice, factor) = (g.times(&by_gamma, 2.0), g.neg(gamma));
    let squares = g.mul(&by_gamma, f);
    let squared = g.sum_over(&squares, &[1]);
    let (constant, none) = (g.neg(&squared), g.times(&squared, 0.0));
    let penalty = g.add_to(&none, 1.0);
    g.concat(&[&twice, &factor, &constant, &penalty], 1)
}

/// `[2, C, rows, columns]` of a padded picture as `[chunks, 2, tiles, tile², C]`.
fn in_chunks(g: &mut Ops, value: &str, channels: i64, pairs: &Pairs, tile: i64) -> String {
    let (tiles, side) = (g.ints(&[TILE]), g.ints(&[tile]));
    let across = g.div(pairs.width, &tiles);
    let first = g.ints(&[2, channels, -1, CHUNK, tile]);
    let shape = g.concat(&[&first, &across, &side], 0);
    let parted = g.reshape(value, &shape);
    let laid = g.transpose(&parted, &[2, 5, 0, 3, 4, 6, 1]);
    g.reshape_to(&laid, &[-1, 2, CHUNK, tile * tile, channels])
}

/// Sums `[chunks, 2, tiles, tile², 14]` as pictures.
fn from_chunks(g: &mut Ops, sums: &str, pairs: &Pairs) -> String {
    let tiles = g.ints(&[TILE]);
    let across = g.div(pairs.width, &tiles);
    let (down, rest) = (g.ints(&[-1]), g.ints(&[2, CHUNK, TILE, TILE, SUMS]));
    let shape = g.concat(&[&down, &across, &rest], 0);
    let parted = g.reshape(sums, &shape);
    let laid = g.transpose(&parted, &[2, 6, 0, 3, 4, 1, 5]);
    let first = g.ints(&[2, SUMS, -1]);
    let shape = g.concat(&[&first, pairs.width], 0);
    g.reshape(&laid, &shape)
}

/// One chunk: `names` of the scanned values in their order, keys seen from the graph around it.
fn body(names: &[&str], pairs: &Pairs) -> GraphProto {
    let mut g = Ops::new("pairs", "pair_");
    for name in names {
        let (kind, dims) = if *name == "start" { (data_type::INT64, 1) } else { (data_type::FLOAT, 4) };
        g.graph.input(&format!("chunk_{name}"), kind, &vec![Dim::Free; dims]);
    }
    let scanned = |name: &str| format!("chunk_{name}");
    let (radius, side) = (pairs.radius, TILE + 2 * pairs.radius);
    let size = g.ints(&[CHUNK_ROWS + 2 * radius, side]);
    let end = g.add("chunk_start", &size);
    // Rows of keys are gathered in twos.
    let rows: Vec<i64> = (0..CHUNK).flat_map(|tile| (0..side / 2).map(move |row| tile * TILE / 2 + row)).collect();
    let rows = g.graph.ints("pair_rows", &[CHUNK as usize, side as usize / 2], &rows);

    // bias - γ_y log(1 + ‖y_c - y_i‖²), the same under all guides.
    let mut of_y = String::new();
    for (i, Values { keys, .. }) in pairs.guides.iter().enumerate() {
        let band = g.slice(keys, "chunk_start", &end, &[2, 3]);
        let in_twos = g.reshape_to(&band, &[2, VALUES, -1, 2 * side]);
        let gathered = g.gather(&in_twos, &rows, 2);
        let flat = g.reshape_to(&gathered, &[2, VALUES, CHUNK, side * side]);
        let all = g.transpose(&flat, &[0, 2, 1, 3]);
        let parts = g.split(&all, &[VALUES - 1, 1], 2);
        let x = g.sub(&parts[0], &scanned(&format!("least_{i}")));
        let squares = g.square(&x);
        let (of_x, of_squares) = (g.split(&x, &GROUPS, 2), g.split(&squares, &GROUPS, 2));
        let logarithm = |g: &mut Ops, group: usize, pixels: &str, only_first: bool| {
            let mut keys = g.concat(&[&of_x[group], &of_squares[group], ONES], 2);
            let mut pixels = pixels.to_string();
            if only_first {
                (keys, pixels) = (g.at(&keys, 0, 0), g.at(&pixels, 0, 0));
            }
            let (product, one) = (g.matmul(&pixels, &keys), g.float(1.0));
            let at_least_one = g.max(&product, &one);
            g.log(&at_least_one)
        };
        if i == 0 {
            let log = logarithm(&mut g, 0, &scanned("y_0"), false);
            let scaled = g.mul(&log, "chunk_gamma_y");
            of_y = g.sub(BIAS, &scaled);
        }
        // The full buffer's z is the same for both halves.
        let log = logarithm(&mut g, 2, &scanned(&format!("z_{i}")), i > 0);
        let of_z = g.mul(&log, "chunk_gamma_z");
        let keys = g.concat(&[&of_x[1], &of_squares[1], ONES, &parts[1]], 2);
        let of_features = g.matmul(&scanned(&format!("f_{i}")), &keys);
        let of_colours = g.sub(&of_y, &of_z);
        let (exponent, nothing) = (g.add(&of_features, &of_colours), g.float(0.0));
        let negative = g.min(&exponent, &nothing);
        let weight = g.exp(&negative);
        let averaged = g.concat(&[&x, ONES], 2);
        let averaged = g.transpose(&averaged, &[0, 1, 3, 2]);
        let output = format!("chunk_sums_{i}");
        g.graph.op("MatMul", &[&weight, &averaged], &output);
        g.graph.output(&output, data_type::FLOAT, &[Dim::Free; 4]);
    }
    g.finish()
}

/// 0 where a key is in a pixel's window and not the pixel itself, [`NEVER`] elsewhere, `[tile², keys]`.
fn bias(radius: i64) -> Vec<f32> {
    let side = TILE + 2 * radius;
    let square = |side: i64| (0..side).flat_map(move |y| (0..side).map(move |x| (y, x)));
    let of_pair = |(y, x): (i64, i64), (v, u): (i64, i64)| {
        let inside = (0..=2 * radius).contains(&(v - y)) && (0..=2 * radius).contains(&(u - x));
        if inside && (v - y, u - x) != (radius, radius) { 0.0 } else { NEVER }
    };
    square(TILE).flat_map(|pixel| square(side).map(move |key| of_pair(pixel, key))).collect()
}
