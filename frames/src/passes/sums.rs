//! Whether passes add up to the noisy colour, in both halves; and if not, what is missing or double.

use sspc_image::{Image, Storage};

/// Largest share of the colour that may be left after rounding: renderers' own sums are exact to it.
pub const TOLERANCE: f64 = 1e-3;
/// Largest share of the difference that may be left for a layer to explain it.
const EXPLAINED: f64 = 0.2;

/// How far a set of passes is from the noisy colour.
#[derive(Clone, Copy, Debug, Default)]
pub struct Difference {
    /// Σ of what the difference exceeds rounding by.
    excess: f64,
    /// Σ of the difference, without its sign.
    size: f64,
    /// Σ of the colour, without its sign.
    colour: f64,
}

/// A pass's contribution to the sum, and how it is kept.
pub struct Part<'a> {
    /// As in the file, `[3, rows, W]`.
    pub pass: &'a Image,
    /// What it is multiplied by.
    pub colour: Option<&'a Image>,
    /// How both are kept.
    pub storage: Storage,
}

impl Part<'_> {
    fn at(&self, c: usize, y: usize, x: usize) -> f64 {
        f64::from(self.pass.at(c, y, x)) * self.colour.map_or(1.0, |colour| f64::from(colour.at(c, y, x)))
    }

    /// Relative rounding: twice where it is a product.
    fn rounding(&self) -> f64 {
        rounding(self.storage) * if self.colour.is_some() { 2.0 } else { 1.0 }
    }
}

fn rounding(storage: Storage) -> f64 {
    match storage {
        Storage::Half => 2f64.powi(-11),
        // Renderers add in single floats, in any order.
        Storage::Float => 2f64.powi(-20),
    }
}

impl Difference {
    /// Looks at some rows.
    pub fn look(&mut self, noisy: &Image, storage: Storage, parts: &[Part]) {
        each_pixel(noisy, parts, |_, target, sum, rounding| {
            let difference = (sum - target).abs();
            self.excess += (difference - rounding - self::rounding(storage) * target.abs() - 1e-7).max(0.0);
            self.size += difference;
            self.colour += target.abs();
        });
    }

    /// What of the colour is missing or too much beyond rounding, as a share of it.
    pub fn share(&self) -> f64 {
        if self.excess == 0.0 { 0.0 } else { self.excess / self.colour.max(f64::MIN_POSITIVE) }
    }

    /// Whether the passes add up.
    pub fn is_none(&self) -> bool {
        self.share() <= TOLERANCE
    }
}

/// How well single layers explain a difference.
#[derive(Clone, Debug)]
pub struct Explanations {
    /// Σ |difference|.
    size: f64,
    /// Σ |difference - layer| of layers that may be missing.
    missing: Vec<f64>,
    /// Σ |difference + pass| of passes that may be double.
    double: Vec<f64>,
}

/// What explains a difference best.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Explanation {
    /// This layer is missing.
    Missing(usize),
    /// This pass is one too many.
    Double(usize),
}

impl Explanations {
    /// Of so many layers and passes.
    pub fn new(layers: usize, passes: usize) -> Self {
        Self { size: 0.0, missing: vec![0.0; layers], double: vec![0.0; passes] }
    }

    /// Looks at some rows.
    pub fn look(&mut self, noisy: &Image, parts: &[Part], layers: &[Part]) {
        each_pixel(noisy, parts, |(c, y, x), target, sum, _| {
            let difference = target - sum;
            self.size += difference.abs();
            for (error, layer) in self.missing.iter_mut().zip(layers) {
                let value = layer.at(c, y, x);
                *error += if value.is_finite() { (difference - value).abs() } else { difference.abs() };
            }
            for (error, part) in self.double.iter_mut().zip(parts) {
                *error += (difference + part.at(c, y, x)).abs();
            }
        });
    }

    /// The best, where there is one.
    pub fn best(&self) -> Option<Explanation> {
        let missing = self.missing.iter().enumerate().map(|(at, error)| (*error, Explanation::Missing(at)));
        let double = self.double.iter().enumerate().map(|(at, error)| (*error, Explanation::Double(at)));
        let best = missing.chain(double).min_by(|a, b| a.0.total_cmp(&b.0))?;
        (best.0 <= EXPLAINED * self.size).then_some(best.1)
    }
}

/// Colour, sum of the parts and its rounding, of every value where all are finite.
fn each_pixel(noisy: &Image, parts: &[Part], mut see: impl FnMut((usize, usize, usize), f64, f64, f64)) {
    for c in 0..3 {
        for y in 0..noisy.height() {
            for x in 0..noisy.width() {
                let target = f64::from(noisy.at(c, y, x));
                let (mut sum, mut error) = (0.0, 0.0);
                for part in parts {
                    let value = part.at(c, y, x);
                    sum += value;
                    error += value.abs() * part.rounding();
                }
                if target.is_finite() && sum.is_finite() {
                    see((c, y, x), target, sum, error);
                }
            }
        }
    }
}
