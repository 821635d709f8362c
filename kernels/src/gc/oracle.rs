//! g_c and its gradient in naive f64, one pixel at a time: the judge of the kernels, slow on purpose.

use super::{Taps, WEIGHT_FLOOR};
use crate::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, NORMAL, RADIANCE, VISIBILITY};
use crate::parameters::{BANDWIDTHS, CENTRE, Form, GATE, SLOPES};
use crate::windows::Windows;

/// One pixel's result.
pub struct Pixel {
    /// g_c (Eq. 10).
    pub g: [f64; 3],
    /// μ̂: g_c, or z + s (g_c - z).
    pub corrected: [f64; 3],
    /// What μ̂ is the sum of, without signs: rounding is relative to this, and its ratio to |μ̂| is the
    /// condition number of the sum.
    pub magnitude: [f64; 3],
    /// 1 / max(Σw, floor): what a rounding of g is multiplied by in the gradients of the weights.
    pub inverse: f64,
    /// Gradient of the parameters given that of μ̂.
    pub gradient: Vec<f64>,
    /// What each gradient is the sum of, without signs: its rounding is relative to this.
    pub gradient_magnitude: Vec<f64>,
}

/// g_c at pixel (y, x) with activated `parameters`, and the gradient of `upstream · μ̂`.
pub fn pixel(
    windows: &Windows,
    taps: &Taps,
    form: Form,
    parameters: &[f64],
    y: usize,
    x: usize,
    upstream: [f64; 3],
) -> Pixel {
    let (y, x) = (y as isize, x as isize);
    let at = |c: usize, (dy, dx): (i32, i32)| f64::from(windows.at(c, y + dy as isize, x + dx as isize));
    let triple = |c: usize, o: (i32, i32)| [at(c, o), at(c + 1, o), at(c + 2, o)];
    let minus = |a: [f64; 3], b: [f64; 3]| [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    let dot = |a: [f64; 3], b: [f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    let valid = |o| valid(windows, (y, x), o);
    let here = (0, 0);

    let mut terms = vec![(parameters[CENTRE] * valid(here), triple(RADIANCE, here), [0.0; 5], [[0.0; 3]; 3])];
    for &i in taps.list() {
        let differences = [DENOISED, ALBEDO, NORMAL].map(|c| minus(triple(c, here), triple(c, i)));
        let distances = distances(windows, (y, x), i);
        let mut u = triple(RADIANCE, i);
        for (f, d) in differences.iter().enumerate() {
            for k in 0..3 {
                u[k] += parameters[SLOPES + 3 * f + k] * d[k];
            }
        }
        terms.push((weight(&distances, parameters) * valid(i), u, distances, differences));
    }
    let weight: f64 = terms.iter().map(|t| t.0).sum();
    let floor = f64::from(WEIGHT_FLOOR);
    let inverse = 1.0 / weight.max(floor);
    let g: [f64; 3] = std::array::from_fn(|k| terms.iter().map(|t| t.0 * t.1[k]).sum::<f64>() * inverse);

    let sizes = |u: [f64; 3], d: &[[f64; 3]; 3], k: usize| {
        u[k].abs() + (0..3).map(|f| (parameters[SLOPES + 3 * f + k] * d[f][k]).abs()).sum::<f64>()
    };
    let of_g: [f64; 3] =
        std::array::from_fn(|k| terms.iter().map(|t| t.0 * sizes(t.1, &t.3, k)).sum::<f64>() * inverse);
    let mut magnitude = of_g;

    let (mut gradient, mut sizes_of_gradient) = (vec![0.0; form.parameters()], vec![0.0; form.parameters()]);
    let z = triple(DENOISED, here);
    let (corrected, by_g) = match form {
        Form::Paper => (g, upstream),
        Form::Gated => {
            let s = parameters[GATE];
            (0..3).for_each(|k| magnitude[k] += z[k].abs());
            gradient[GATE] = dot(upstream, minus(g, z));
            sizes_of_gradient[GATE] = (0..3).map(|k| upstream[k].abs() * magnitude[k]).sum();
            (std::array::from_fn(|k| z[k] + s * (g[k] - z[k])), upstream.map(|v| v * s))
        }
    };
    let held = if weight > floor { dot(by_g, g) } else { 0.0 };
    for (i, (w, u, distances, differences)) in terms.iter().enumerate() {
        let by_weight = (dot(by_g, *u) - held) * inverse;
        let size: f64 = (0..3).map(|k| by_g[k].abs() * (sizes(*u, differences, k) + of_g[k]) * inverse).sum();
        if i == 0 {
            gradient[CENTRE] = by_weight * valid(here);
            sizes_of_gradient[CENTRE] = size * valid(here);
        }
        for (m, d) in distances.iter().enumerate() {
            gradient[BANDWIDTHS + m] -= by_weight * w * d;
            sizes_of_gradient[BANDWIDTHS + m] += size * w * d;
        }
        for (f, d) in differences.iter().enumerate() {
            for k in 0..3 {
                let term = by_g[k] * inverse * w * d[k];
                gradient[SLOPES + 3 * f + k] += term;
                sizes_of_gradient[SLOPES + 3 * f + k] += term.abs();
            }
        }
    }
    Pixel { g, corrected, magnitude, inverse, gradient, gradient_magnitude: sizes_of_gradient }
}

/// Σ w_i x_i / max(Σ w_i, floor) at pixel (y, x) of a plane `x`, which is given by the offset from the pixel; and the same
/// of |x|, which rounding is relative to.
pub fn mean(
    windows: &Windows,
    taps: &Taps,
    parameters: &[f64],
    (y, x): (usize, usize),
    plane: impl Fn((i32, i32)) -> f64,
) -> (f64, f64) {
    let at = (y as isize, x as isize);
    let of_tap = |&i: &(i32, i32)| (weight(&distances(windows, at, i), parameters) * valid(windows, at, i), plane(i));
    let centre = (parameters[CENTRE] * valid(windows, at, (0, 0)), plane((0, 0)));
    let terms: Vec<(f64, f64)> = taps.list().iter().map(of_tap).chain([centre]).collect();
    let sum = |of: fn(f64) -> f64| terms.iter().map(|(w, x)| w * of(*x)).sum::<f64>();
    let inverse = 1.0 / sum(|_| 1.0).max(f64::from(WEIGHT_FLOOR));
    (sum(|x| x) * inverse, sum(f64::abs) * inverse)
}

/// The five distances of (6) between a pixel (y, x) and the one at this offset from it.
fn distances(windows: &Windows, (y, x): (isize, isize), (dy, dx): (i32, i32)) -> [f64; 5] {
    let difference =
        |c: usize| f64::from(windows.at(c, y, x)) - f64::from(windows.at(c, y + dy as isize, x + dx as isize));
    let squared = |c: usize| (c..c + 3).map(|c| difference(c).powi(2)).sum::<f64>();
    [
        squared(ALBEDO),
        squared(NORMAL),
        difference(VISIBILITY).powi(2),
        squared(RADIANCE).ln_1p(),
        squared(DENOISED).ln_1p(),
    ]
}

fn weight(distances: &[f64; 5], parameters: &[f64]) -> f64 {
    (-distances.iter().zip(&parameters[BANDWIDTHS..]).map(|(d, gamma)| d * gamma).sum::<f64>()).exp()
}

/// 1 where the pixel at an offset from (y, x) counts, 0 where it is missing.
fn valid(windows: &Windows, (y, x): (isize, isize), (dy, dx): (i32, i32)) -> f64 {
    if windows.masked() { f64::from(windows.at(FEATURE_CHANNELS, y + dy as isize, x + dx as isize)) } else { 1.0 }
}
