//! The extreme inputs of the kernels.

use crate::table::Worst;
use sspc_core::prepare::Prepared;
use sspc_core::rng::Rng;
use sspc_image::Image;
use sspc_kernels::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, NORMAL, RADIANCE, VISIBILITY};
use sspc_kernels::gc::WEIGHT_FLOOR;
use sspc_kernels::parameters::{BANDWIDTHS, CENTRE, Form};
use sspc_testkit::frames::{prepared, textured};
use std::ops::Range;

/// Below this f32 loses its bits one by one; errors are not measured relative to less.
pub const SMALLEST: f64 = 1e-30;
/// Of the windows.
const TAPS: f64 = 361.0;

/// Features of both halves in the method's units, and outputs of a network for half a.
#[derive(Clone)]
pub struct Case {
    pub name: String,
    pub halves: [Image; 2],
    pub valid: Option<Image>,
    /// Outputs before activation, `[16, H, W]`.
    pub raw: Image,
}

impl Case {
    pub fn height(&self) -> usize {
        self.raw.height()
    }

    pub fn width(&self) -> usize {
        self.raw.width()
    }

    /// The outputs of `form`, `[P, H, W]` flat.
    pub fn outputs(&self, form: Form) -> &[f32] {
        &self.raw.data()[..form.parameters() * self.raw.pixels()]
    }

    /// The case as a prepared frame, exposure 1, everything computed.
    pub fn prepared(&self) -> Prepared {
        Prepared { valid: self.valid.clone(), ..prepared(self.halves.clone()) }
    }

    /// Largest magnitude of the features `channels` of half a.
    fn largest(&self, channels: Range<usize>) -> f64 {
        channels.flat_map(|c| self.halves[0].plane(c)).fold(0.0, |m: f64, v| m.max(f64::from(v.abs())))
    }

    /// What the kernels may add to g_c, and to a gradient for each unit of upstream gradient, where the
    /// truth falls below it: a weight is never less than 2^-126, and Σw counts as 1e-5 at least.
    pub fn of_vanished_weights(&self) -> Worst {
        let weights = (TAPS * f64::from(f32::MIN_POSITIVE) / f64::from(WEIGHT_FLOOR)).max(SMALLEST);
        let value = weights * (4.0 * self.largest(0..FEATURE_CHANNELS)).max(1.0);
        // Features go into the exponent by their squares, radiance by a logarithm below 256.
        let distance = 12.0 * self.largest(ALBEDO..DENOISED).powi(2) + 256.0;
        Worst { value, gradient: value * distance }
    }

    fn named(mut self, name: impl Into<String>) -> Self {
        self.name = name.into();
        self
    }

    /// Applies `change` to every value of `channels` in both halves.
    fn map(mut self, channels: &[Range<usize>], change: impl Fn(f32) -> f32) -> Self {
        for half in &mut self.halves {
            for c in channels.iter().cloned().flatten() {
                half.plane_mut(c).iter_mut().for_each(|v| *v = change(*v));
            }
        }
        self
    }

    /// Gives the outputs `channels` one value.
    fn outputs_at(mut self, channels: Range<usize>, value: f32) -> Self {
        channels.for_each(|c| self.raw.plane_mut(c).fill(value));
        self
    }

    /// Gives the middle pixel of half a `value` in `channels`.
    fn middle(mut self, channels: Range<usize>, value: f32) -> Self {
        let (y, x) = (self.height() / 2, self.width() / 2);
        channels.for_each(|c| self.halves[0].set(c, y, x, value));
        self
    }

    /// Marks every third pixel or so missing, with zero features as the pipeline has them.
    fn with_missing(mut self, rng: &mut Rng) -> Self {
        let valid = Image::from_fn(1, self.height(), self.width(), |_, _, _| f32::from(rng.uniform() > 0.3));
        for half in &mut self.halves {
            for c in 0..FEATURE_CHANNELS {
                half.plane_mut(c).iter_mut().zip(valid.data()).for_each(|(v, ok)| *v *= ok);
            }
        }
        self.valid = Some(valid);
        self
    }
}

const COLOURS: [Range<usize>; 2] = [RADIANCE..RADIANCE + 3, DENOISED..DENOISED + 3];
const BANDWIDTH_OUTPUTS: Range<usize> = BANDWIDTHS..CENTRE;

/// A textured scene with edges; noisy in both halves, the denoised colour less so.
pub fn usual(height: usize, width: usize) -> Case {
    let rng = &mut Rng::new((height * 1000 + width) as u64);
    let halves = textured(height, width, rng);
    let raw = Image::from_fn(Form::Gated.parameters(), height, width, |_, _, _| 1.5 * rng.normal());
    Case { name: "as rendered".into(), halves, valid: None, raw }
}

/// Every case.
pub fn all() -> Vec<Case> {
    let rng = &mut Rng::new(77);
    let base = || usual(20, 24);
    let mut cases = vec![base()];
    for exponent in [-8, -4, 4, 8] {
        let factor = 10f32.powi(exponent);
        cases.push(base().map(&COLOURS, |v| v * factor).named(format!("exposure 1e{exponent}")));
    }
    cases.extend([
        base().outputs_at(BANDWIDTH_OUTPUTS, -30.0).named("bandwidths at 1e4"),
        base().outputs_at(BANDWIDTH_OUTPUTS, 3e3).named("bandwidths at 1e-7"),
        base().outputs_at(BANDWIDTH_OUTPUTS, -30.0).outputs_at(CENTRE..CENTRE + 1, -100.0).named("all weights vanish"),
        base()
            .with_missing(rng)
            .outputs_at(BANDWIDTH_OUTPUTS, -30.0)
            .outputs_at(CENTRE..CENTRE + 1, -100.0)
            .named("all weights vanish, some missing"),
        base().with_missing(rng).named("some pixels missing"),
        base().map(&[0..FEATURE_CHANNELS], |_| 0.7).named("equal neighbours"),
        base().map(&[0..FEATURE_CHANNELS], |_| 0.0).named("black"),
        base().middle(RADIANCE..RADIANCE + 3, 1e6).named("one bright pixel of y, 1e6"),
        base().middle(RADIANCE..RADIANCE + 3, 1e6).middle(DENOISED..DENOISED + 3, 1e6).named("of y and z, 1e6"),
        base().map(&COLOURS, |v| v * 1e-40).named("denormals"),
        base().map(&COLOURS, |v| v * 5e14).named("largest radiance, 1e15"),
        base()
            .map(&[ALBEDO..VISIBILITY, VISIBILITY..NORMAL, NORMAL..DENOISED], |v| (v - 0.2) * 2e4)
            .named("features at 1e4"),
        equal_but_for_one_pixel(base()),
    ]);
    for (height, width) in [(1, 1), (1, 37), (41, 1), (4, 5), (19, 23)] {
        cases.push(usual(height, width).named(format!("{height} x {width}, window of 19 x 19")));
    }
    cases
}

fn equal_but_for_one_pixel(mut case: Case) -> Case {
    case.halves[1] = case.halves[0].clone();
    case.middle(RADIANCE..RADIANCE + 1, 0.9).named("halves equal but for one pixel")
}
