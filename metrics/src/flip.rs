//! ꟻLIP for displayed pictures: what an observer notices when flipping between two images.
//!
//! P. Andersson, J. Nilsson, T. Akenine-Möller, M. Oskarsson, K. Åström, M. D. Fairchild, "FLIP: A Difference
//! Evaluator for Alternating Images", HPG 2020. Section numbers below are the paper's. Written from the paper because the
//! available crate wraps C++; a test compares it with that crate's result.

use crate::filter::{Plane, gaussian, normalised, offsets};
use sspc_image::Image;

/// Pixels per degree of visual angle: a 3840-pixel, 0.7 m wide monitor seen from 0.7 m (Sect. 6).
pub const PIXELS_PER_DEGREE: f64 = 67.020_643;
/// D65 white, XYZ of RGB (1, 1, 1).
const WHITE: [f64; 3] = [0.950_428_545, 1.0, 1.088_900_371];
/// Linear sRGB to XYZ, rows X, Y, Z.
const RGB_TO_XYZ: [[f64; 3]; 3] = [
    [10_135_552.0 / 24_577_794.0, 8_788_810.0 / 24_577_794.0, 4_435_075.0 / 24_577_794.0],
    [2_613_072.0 / 12_288_897.0, 8_788_810.0 / 12_288_897.0, 887_015.0 / 12_288_897.0],
    [1_425_312.0 / 73_733_382.0, 8_788_810.0 / 73_733_382.0, 70_074_185.0 / 73_733_382.0],
];
/// Contrast sensitivity as sums of Gaussians, (a, b) of each term: achromatic, red-green, blue-yellow (Table 1).
const SENSITIVITY: [&[(f64, f64)]; 3] = [&[(1.0, 0.0047)], &[(1.0, 0.0053)], &[(34.1, 0.04), (13.5, 0.025)]];
/// The widest Gaussian of the sensitivities, which sets the radius.
const WIDEST: f64 = 0.04;
/// Exponents of colour and feature differences (Sects. 4.1.3 and 4.2.2).
const COLOUR_EXPONENT: f64 = 0.7;
const FEATURE_EXPONENT: f64 = 0.5;
/// Colour differences up to 0.4 of the largest are stretched over 0..0.95 (Sect. 4.1.3).
const KNEE: f64 = 0.4;
const KNEE_ERROR: f64 = 0.95;
/// Width of the feature detectors in degrees (Sect. 4.2.1).
const FEATURE_WIDTH: f64 = 0.082;

/// The error of every pixel, 0..1, of two displayed `[3, H, W]` images, 0..1 and sRGB-encoded, seen at
/// `pixels_per_degree`.
///
/// # Panics
/// When the images do not have one shape of 3 channels.
pub fn flip_map(picture: &Image, reference: &Image, pixels_per_degree: f64) -> Plane {
    assert!(picture.same_size(reference) && picture.channels() == 3 && reference.channels() == 3);
    let (x, r) = (Perceived::of(picture, pixels_per_degree), Perceived::of(reference, pixels_per_degree));
    let largest = hyab(hunt_lab([0.0, 1.0, 0.0]), hunt_lab([0.0, 0.0, 1.0])).powf(COLOUR_EXPONENT);
    let knee = KNEE * largest;
    Plane::from_fn(picture.width(), picture.height(), |i| {
        let distance = hyab(x.lab(i), r.lab(i)).powf(COLOUR_EXPONENT);
        let colour = match distance < knee {
            true => KNEE_ERROR * distance / knee,
            false => KNEE_ERROR + (1.0 - KNEE_ERROR) * (distance - knee) / (largest - knee),
        };
        let edges = f64::from((x.edges.data[i] - r.edges.data[i]).abs());
        let points = f64::from((x.points.data[i] - r.points.data[i]).abs());
        let feature = (edges.max(points) / 2.0f64.sqrt()).powf(FEATURE_EXPONENT);
        colour.powf(1.0 - feature) as f32
    })
}

/// A picture as seen at that distance.
struct Perceived {
    /// Hunt-adjusted L*a*b* after the contrast sensitivity (Sect. 4.1).
    lab: [Plane; 3],
    /// Edges and points of the achromatic plane (Sect. 4.2).
    edges: Plane,
    points: Plane,
}

impl Perceived {
    fn of(image: &Image, ppd: f64) -> Self {
        let (width, height) = (image.width(), image.height());
        let opponent = |c: usize| Plane::from_fn(width, height, |i| opponent(linear_rgb(image, i))[c] as f32);
        let [y, cx, cz] = [0, 1, 2].map(opponent);
        let grey = Plane::from_fn(width, height, |i| (y.data[i] + 16.0) / 116.0);
        let seen = [(&y, 0), (&cx, 1), (&cz, 2)].map(|(plane, c)| sensed(plane, SENSITIVITY[c], ppd));
        let lab_at = |i: usize| hunt_lab(rgb_of_opponent([0, 1, 2].map(|c| f64::from(seen[c].data[i]))));
        let lab = [0, 1, 2].map(|c| Plane::from_fn(width, height, |i| lab_at(i)[c] as f32));
        let (edges, points) = features(&grey, ppd);
        Self { lab, edges, points }
    }

    fn lab(&self, i: usize) -> [f64; 3] {
        [0, 1, 2].map(|c| f64::from(self.lab[c].data[i]))
    }
}

fn linear_rgb(image: &Image, i: usize) -> [f64; 3] {
    [0, 1, 2].map(|c| {
        let encoded = f64::from(image.plane(c)[i]);
        if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
    })
}

fn relative_xyz(rgb: [f64; 3]) -> [f64; 3] {
    [0, 1, 2].map(|row| (0..3).map(|c| RGB_TO_XYZ[row][c] * rgb[c]).sum::<f64>() / WHITE[row])
}

/// The linear opponent space YCxCz.
fn opponent(rgb: [f64; 3]) -> [f64; 3] {
    let [x, y, z] = relative_xyz(rgb);
    [116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)]
}

fn rgb_of_opponent([y, cx, cz]: [f64; 3]) -> [f64; 3] {
    let y = (y + 16.0) / 116.0;
    let xyz = [WHITE[0] * (y + cx / 500.0), WHITE[1] * y, WHITE[2] * (y - cz / 200.0)];
    solve(RGB_TO_XYZ, xyz).map(|value| value.clamp(0.0, 1.0))
}

/// Solves `m x = v` by Cramer's rule.
fn solve(m: [[f64; 3]; 3], v: [f64; 3]) -> [f64; 3] {
    let determinant = |m: [[f64; 3]; 3]| {
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) - m[0][1] * (m[1][0] * m[2][2] - m[1][2] * m[2][0])
            + m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0])
    };
    let whole = determinant(m);
    [0, 1, 2].map(|column| {
        let mut replaced = m;
        (0..3).for_each(|row| replaced[row][column] = v[row]);
        determinant(replaced) / whole
    })
}

/// L*a*b*, with a* and b* scaled by lightness after Hunt (Sect. 4.1.2).
fn hunt_lab(rgb: [f64; 3]) -> [f64; 3] {
    const DELTA: f64 = 6.0 / 29.0;
    let curve = |t: f64| if t > DELTA.powi(3) { t.cbrt() } else { t / (3.0 * DELTA * DELTA) + 4.0 / 29.0 };
    let [x, y, z] = relative_xyz(rgb).map(curve);
    let lightness = 116.0 * y - 16.0;
    [lightness, 0.01 * lightness * 500.0 * (x - y), 0.01 * lightness * 200.0 * (y - z)]
}

/// City-block in lightness, Euclidean in chroma.
fn hyab(p: [f64; 3], q: [f64; 3]) -> f64 {
    (p[0] - q[0]).abs() + (p[1] - q[1]).hypot(p[2] - q[2])
}

/// A sum of two-dimensional Gaussians, a·√(π/b)·exp(−π²d²/b) with d in degrees, normalised as a whole.
fn sensed(plane: &Plane, terms: &[(f64, f64)], ppd: f64) -> Plane {
    use std::f64::consts::PI;
    let radius = (3.0 * (WIDEST / (2.0 * PI * PI)).sqrt() * ppd).ceil() as usize;
    let of_term = |&(a, b): &(f64, f64)| {
        let taps: Vec<f64> = offsets(radius).map(|x| (-(PI * x / ppd).powi(2) / b).exp()).collect();
        (a * (PI / b).sqrt(), taps)
    };
    let kernels: Vec<(f64, Vec<f64>)> = terms.iter().map(of_term).collect();
    let total: f64 = kernels.iter().map(|(weight, taps)| weight * taps.iter().sum::<f64>().powi(2)).sum();
    let parts: Vec<Plane> = kernels
        .iter()
        .map(|(weight, taps)| {
            let scaled: Vec<f64> = taps.iter().map(|tap| tap * weight / total).collect();
            plane.filtered(&scaled, taps)
        })
        .collect();
    Plane::from_fn(plane.width, plane.height, |i| parts.iter().map(|part| part.data[i]).sum())
}

/// Magnitudes of the first and second derivative of a Gaussian, each with positive and negative weights of sum 1.
fn features(grey: &Plane, ppd: f64) -> (Plane, Plane) {
    let sigma = 0.5 * FEATURE_WIDTH * ppd;
    let radius = (3.0 * sigma).ceil() as usize;
    let smooth = normalised(gaussian(sigma, radius));
    let bell = gaussian(sigma, radius);
    let first = balanced(offsets(radius).zip(&bell).map(|(x, g)| -x * g).collect());
    let second = balanced(offsets(radius).zip(&bell).map(|(x, g)| (x * x / (sigma * sigma) - 1.0) * g).collect());
    let magnitude = |taps: &[f64]| {
        let (dx, dy) = (grey.filtered(taps, &smooth), grey.filtered(&smooth, taps));
        Plane::from_fn(grey.width, grey.height, |i| dx.data[i].hypot(dy.data[i]))
    };
    (magnitude(&first), magnitude(&second))
}

/// Scales positive weights to a sum of 1 and negative ones to -1.
fn balanced(mut weights: Vec<f64>) -> Vec<f64> {
    let positive: f64 = weights.iter().filter(|w| **w > 0.0).sum();
    let negative: f64 = -weights.iter().filter(|w| **w < 0.0).sum::<f64>();
    weights.iter_mut().for_each(|w| *w /= if *w > 0.0 { positive } else { negative });
    weights
}
