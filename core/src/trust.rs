//! What is done about halves whose noise is not independent: nothing, a loss that takes it into account, or no
//! correction at all.
//!
//! **Shared noise.** With a correlation ρ between n^a and n^b of equal variance, (y^b - ρ y^a) / (1 - ρ) is still
//! unbiased, and its noise is uncorrelated with that of y^a. In the place of y^b, in the loss, the blend weight and the
//! estimates, it makes them what they are with independent halves, at (1 + ρ) / (1 - ρ) times the variance. It is used
//! from [`NEGLIGIBLE`] on.
//!
//! **Too much.** Far below zero the halves' own pictures are so much worse than the full buffer's that what helps them
//! says nothing of it; far above, an error of ρ weighs 1 / (1 - ρ). The denoiser's picture is the answer then, aloud.

use crate::frame_stats::FrameStats;
use crate::independence::Independence;
use std::fmt;

/// Correlations up to this, either way, are left alone: independent halves were measured from -0.04 to 0.06, and 0.1
/// injected does no harm.
pub const NEGLIGIBLE: f64 = 0.1;
/// The most negative and the largest correlation that a loss is made for.
pub const CORRECTABLE: (f64, f64) = (-0.4, 0.85);
/// Difference of the halves' brightness, as a share of it, beyond which they are not of one exposure.
pub const BRIGHTNESS_DIFFERS: f64 = 0.05;
/// Energy of one half's residual over the other's beyond which one of them is no render: a filter takes away more.
pub const NOISE_DIFFERS: f64 = 12.0;
/// Correlation of the halves' edges of albedo and normal below which they are of different pictures.
pub const EDGES_DIFFER: f64 = 0.5;

/// What may be made of a frame's halves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trust {
    /// They are what they claim to be, as far as can be told.
    Independent,
    /// Their noise has this correlation, which the loss is freed of.
    SharedNoise(f64),
    /// Nothing: the picture is the denoiser's.
    None(Distrust),
}

/// Why halves are not used.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distrust {
    /// The correlation of their noise.
    Correlated(f64),
    /// Brightness of half a over that of half b, of the channel (0..2) that differs most.
    Brightness(usize, f64),
    /// Energy of y - z of half a over that of half b.
    Noise(f64),
    /// Correlation of their edges of albedo and normal.
    Edges(f64),
}

impl Trust {
    /// The answer to what was measured.
    pub fn of(found: &Independence) -> Self {
        if let Some(distrust) = different_pictures(found) {
            return Trust::None(distrust);
        }
        match found.correlation {
            Some(r) if !(CORRECTABLE.0..=CORRECTABLE.1).contains(&r) => Trust::None(Distrust::Correlated(r)),
            Some(r) if r.abs() > NEGLIGIBLE => Trust::SharedNoise(r),
            _ => Trust::Independent,
        }
    }

    /// The correlation that the loss is freed of; 0 where it is left as it is.
    pub fn shared_noise(self) -> f32 {
        match self {
            Trust::SharedNoise(r) => r as f32,
            Trust::Independent | Trust::None(_) => 0.0,
        }
    }

    /// What a person should know.
    pub fn warning(self) -> Option<String> {
        match self {
            Trust::Independent => None,
            Trust::SharedNoise(r) => Some(format!(
                "the noise of the halves is correlated ({r:+.2}, expected 0 within {NEGLIGIBLE}): the loss is freed of it, and corrects less; \
                 render the halves with independent seeds"
            )),
            Trust::None(distrust) => Some(distrust.to_string()),
        }
    }
}

fn different_pictures(found: &Independence) -> Option<Distrust> {
    if let Some(r) = found.edges.filter(|r| *r < EDGES_DIFFER) {
        return Some(Distrust::Edges(r));
    }
    if found.noise_ratio > NOISE_DIFFERS || found.noise_ratio < 1.0 / NOISE_DIFFERS {
        return Some(Distrust::Noise(found.noise_ratio));
    }
    let off = |k: &usize| found.brightness[*k].ln().abs();
    let worst = (0..3).max_by(|p, q| off(p).total_cmp(&off(q)))?;
    (off(&worst) > BRIGHTNESS_DIFFERS.ln_1p()).then(|| Distrust::Brightness(worst, found.brightness[worst]))
}

impl fmt::Display for Distrust {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Distrust::Correlated(r) => write!(
                f,
                "the noise of the halves is correlated ({r:+.2}, expected 0): render them with independent seeds"
            ),
            Distrust::Brightness(k, ratio) => write!(
                f,
                "half a is {ratio:.3} times as bright as half b in {} (expected 1 within {BRIGHTNESS_DIFFERS}): give both one exposure and white balance",
                ["red", "green", "blue"][*k]
            ),
            Distrust::Noise(ratio) => write!(
                f,
                "half a differs from its denoised picture by {ratio:.3} times the energy of half b (expected 1/{NOISE_DIFFERS} to {NOISE_DIFFERS}): one of them is filtered or denoised already"
            ),
            Distrust::Edges(r) => write!(
                f,
                "the edges of the halves' albedo and normal lie in different places (correlation {r:.2}, expected above {EDGES_DIFFER}): they are of different frames or geometry"
            ),
        }
    }
}

impl FrameStats {
    /// What may be made of the halves.
    pub fn trust(&self) -> Trust {
        Trust::of(&self.independence)
    }
}
