//! Presets: how a corrector is started and trained.

use crate::combination::Combination;
use sspc_cli::{Mode, Quality, UnaskedModes};
use sspc_core::composition::Composition;
use sspc_core::frame_stats::Exposure;
use sspc_core::held_out;
use sspc_kernels::features::FeatureSet;
use sspc_kernels::gc::PAPER_RADIUS;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use std::fmt;

/// Named settings of the command line.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Preset {
    /// The paper's network, start, patches, rate and 20 epochs.
    Paper,
    /// Fewer steps than `balanced`, at a higher rate, with a smaller network and windows of 13 x 13 pixels.
    Fast,
    /// Starts near z plus a smoothed residual, trains a shallow network on small mirrored tiles.
    Balanced,
    /// As `balanced`, with more steps, the more the larger the picture.
    Quality,
}

impl Preset {
    /// How frames are denoised that have no denoised pictures, where nobody says: the more time a preset takes, the more
    /// different pictures there are to correct from.
    pub fn denoising(self) -> UnaskedModes {
        use Mode::{Aux, CleanAux, Colour};
        match self {
            Preset::Paper | Preset::Fast => UnaskedModes::to_make_z(&[Aux], Quality::High),
            Preset::Balanced => UnaskedModes::to_make_z(&[Aux, CleanAux], Quality::Balanced),
            Preset::Quality => UnaskedModes::to_make_z(&[Aux, CleanAux, Colour], Quality::High),
        }
    }
}

impl fmt::Display for Preset {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Preset::Paper => "paper",
            Preset::Fast => "fast",
            Preset::Balanced => "balanced",
            Preset::Quality => "quality",
        })
    }
}

/// Where training starts.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Start {
    /// Random weights, as in the paper.
    Random,
    /// g_c ≈ z + smoothed (y - z), and this gate towards z.
    Analytic {
        /// The gate, 0..1.
        gate: f64,
    },
}

/// Which tiles a step sees.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sampling {
    /// Every patch of a grid of this stride once an epoch, in random order, both halves of each.
    Grid {
        /// Pixels from one patch to the next.
        stride: usize,
    },
    /// Random places, half of them from each half buffer, mirrored at random.
    Uniform,
    /// The same, more often where the denoised halves differ (`importance.rs`).
    Important,
}

/// The learning rate over the steps.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Rate {
    /// `factor` · √mean((y^a - y^b)² / 4), constant (the paper's rule).
    NoiseScaled {
        /// The factor.
        factor: f64,
    },
    /// Linear warm-up to `peak`, then a half cosine to zero.
    Cosine {
        /// Highest rate.
        peak: f64,
        /// Steps until it is reached.
        warm_up: usize,
    },
}

/// Whose z is in the denominator of the loss.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Denominator {
    /// That of the half compared with (the paper).
    OtherHalf,
    /// That of the half corrected ([`sspc_core::objective::own_weight`]).
    OwnHalf,
}

/// The weighted error norm m from which a pixel's gradient is limited ([`Objective::loss`]), over
/// the steps: from the first to the last in equal ratios. While the rate is high, outliers of y would
/// throw the weights about; at the end, when steps are small, they should have their say.
///
/// [`Objective::loss`]: sspc_core::objective::Objective::loss
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Influence {
    /// At the first step.
    pub first: f32,
    /// At the last.
    pub last: f32,
}

impl Influence {
    /// No limit.
    pub const UNLIMITED: Influence = Influence::constant(f32::INFINITY);

    /// One limit at every step.
    pub const fn constant(limit: f32) -> Self {
        Influence { first: limit, last: limit }
    }

    /// The limit when this share of the training, 0..1, is done.
    pub fn at(self, done: f64) -> f32 {
        if self.first == self.last { self.first } else { self.first * (self.last / self.first).powf(done as f32) }
    }
}

fn limit_or_null<S: serde::Serializer>(influence: &Influence, serializer: S) -> Result<S::Ok, S::Error> {
    let limited = (*influence != Influence::UNLIMITED).then_some(influence);
    serde::Serialize::serialize(&limited, serializer)
}

/// Radius of g_c's window where time matters: less than half the taps, a hundredth more error after as many steps.
const SMALL_RADIUS: usize = 6;

/// Share of the training in which windows may be smaller than in the picture. (`balanced`, 13x13 before 19x19, nine frames and
/// four seeds: 1.003 of the error and 0.78 of the processor time; 9x9 before 19x19 1.011 and 0.68. A fourth or half of the taps
/// of the whole window, in a lattice, is no better at equal time. `quality`, two seeds: 1.012 and 0.75; `fast`, 9x9 before 13x13:
/// 1.003 and 0.90.)
const EARLY: f64 = 0.8;

/// Radius of the first windows of each of several networks. (`balanced`, two networks, nine frames and two seeds: 0.997 of the error
/// of whole windows, 0.86 of the training time.)
const EARLY_RADIUS_OF_SEVERAL: usize = 4;

/// `quality`'s steps are for this many pixels at least.
const QUALITY_STEPS_GROW_FROM: usize = 640 * 360;

/// `quality`'s steps of each of several networks.
const QUALITY_STEPS_OF_SEVERAL: usize = 800;

/// What of a frame that needs no work is left out.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
pub struct Skip {
    /// Blocks of pixels without noise.
    pub blocks: bool,
    /// Features that are constant or absent.
    pub features: bool,
}

impl Skip {
    /// Everything that needs no work is left out.
    pub const ALL: Skip = Skip { blocks: true, features: true };
}

/// Weight of differences of y where nobody asks for them: none. What helps one scene darkens corners of another
/// (docs/GRADIENTS.md).
const DIFFERENCE_STRENGTH: f32 = 0.0;

/// Reports name it where it was changed.
fn is_usual(strength: &f32) -> bool {
    *strength == DIFFERENCE_STRENGTH
}

/// Adam moves every weight by about the rate: above this a network of weights near 0.1 is lost.
pub const LARGEST_RATE: f64 = 0.1;

/// Everything that decides how a fit runs; in reports as it stands.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Settings {
    /// The preset that the settings began as.
    pub preset: Preset,
    /// Form of the parameters.
    pub form: Form,
    /// Layers and channels of the network.
    #[serde(rename = "network")]
    pub shape: Shape,
    /// Radius of g_c's window, pixels.
    #[serde(rename = "window_radius")]
    pub radius: usize,
    /// Radius of the window in the first four fifths of the training, where it is smaller than `radius`.
    #[serde(rename = "early_window_radius")]
    pub early_radius: usize,
    /// How radiance is brought to the method's scale.
    pub exposure: Exposure,
    /// The weights before the first step.
    pub start: Start,
    /// g_c, or f_c.
    pub combination: Combination,
    /// Which tiles a step sees.
    pub sampling: Sampling,
    /// Whether random tiles are mirrored in all eight ways: four otherwise, without the diagonal.
    pub diagonal: bool,
    /// Side of a tile in pixels; smaller pictures are one tile.
    pub tile: usize,
    /// Tiles a step; of a grid, places, each of which gives a tile of both halves.
    pub batch: usize,
    /// The learning rate over the steps.
    pub rate: Rate,
    /// Steps; for grids epochs decide instead.
    pub steps: usize,
    /// Pictures of more pixels than this take more steps, in proportion to the root of their pixels.
    pub steps_grow_from: Option<usize>,
    /// Epochs over a grid.
    pub epochs: usize,
    /// Whose z is in the loss's denominator.
    pub denominator: Denominator,
    /// From which error on a pixel's gradient is limited; null in reports where it is not.
    #[serde(serialize_with = "limit_or_null")]
    pub influence: Influence,
    /// How heavily differences of y weigh that a gradient-domain renderer gives, times what their noise deserves; 0: not.
    #[serde(rename = "differences", skip_serializing_if = "is_usual")]
    pub difference_strength: f32,
    /// What the picture is made of.
    pub composition: Composition,
    /// Features that may take part: all, or those of the model that training starts from.
    pub features: FeatureSet,
    /// Whether one block in eight is not trained on and judges the picture ([`held_out`]). In no preset: where fireflies
    /// decide, one frame of fur in four seeds came out 1.5 times the denoiser's error, and 0.9 without.
    pub held_out: bool,
    /// What of a frame is left out where it needs no work.
    pub skip: Skip,
    /// Settings that are not the preset's own, KEY=VALUE.
    #[serde(rename = "changed")]
    pub changes: Vec<String>,
    /// Seed of weights and tiles.
    pub seed: u64,
}

impl Settings {
    /// Radius of g_c's window when this share of the training, 0..1, is done.
    pub fn radius_at(&self, done: f64) -> usize {
        if done < EARLY { self.early_radius.min(self.radius) } else { self.radius }
    }

    /// Whether training leaves out pixels of a frame of this size, to judge the picture by: not where they would be too
    /// few.
    pub fn leaves_pixels_out(&self, height: usize, width: usize) -> bool {
        self.held_out && self.composition == Composition::JudgedFullBuffer && held_out::are_enough(height, width)
    }

    /// The settings with which so many networks are fitted, one for each denoised picture of a half. Several need no windows
    /// as large, and many steps do better on tiles of weight: where one network learns their noise by heart, the mean of
    /// several does not. (`quality`, three networks, geometric mean of five frames: 0.49 of the denoiser's error; 500 steps on
    /// large windows and tiles from anywhere, which take as long, 0.51.)
    pub fn shared_by(mut self, networks: usize) -> Self {
        let is_changed = |key: &str| self.changes.iter().any(|change| change.split('=').next() == Some(key));
        if networks > 1 && matches!(self.preset, Preset::Balanced | Preset::Quality) && !is_changed("window") {
            self.radius = SMALL_RADIUS;
        }
        if networks > 1 && self.preset == Preset::Balanced && !is_changed("early-window") {
            self.early_radius = EARLY_RADIUS_OF_SEVERAL;
        }
        if networks > 1 && self.preset == Preset::Quality {
            self.steps = QUALITY_STEPS_OF_SEVERAL;
            if !is_changed("sampling") {
                (self.sampling, self.diagonal) = (Sampling::Important, false);
            }
        }
        self
    }

    /// The settings of a preset.
    pub fn of(preset: Preset, seed: u64) -> Self {
        let (steps, peak) = match preset {
            Preset::Fast => (80, 6e-3),
            Preset::Quality => (1000, 4e-3),
            Preset::Balanced | Preset::Paper => (300, 4e-3),
        };
        let ours = Settings {
            preset,
            form: Form::Gated,
            shape: Shape::shallow(Form::Gated),
            radius: PAPER_RADIUS,
            early_radius: PAPER_RADIUS,
            exposure: Exposure::OfNoise,
            start: Start::Analytic { gate: 0.7 },
            combination: Combination::PostCorrection,
            sampling: Sampling::Important,
            diagonal: false,
            tile: 48,
            batch: 8,
            rate: Rate::Cosine { peak, warm_up: 10 },
            steps,
            steps_grow_from: None,
            epochs: 0,
            denominator: Denominator::OwnHalf,
            influence: Influence { first: 1.0, last: 10.0 },
            difference_strength: DIFFERENCE_STRENGTH,
            composition: Composition::JudgedFullBuffer,
            features: FeatureSet::ALL,
            held_out: false,
            skip: Skip::ALL,
            changes: Vec::new(),
            seed,
        };
        match preset {
            Preset::Paper => Settings {
                form: Form::Paper,
                shape: Shape::paper(Form::Paper),
                exposure: Exposure::AsIs,
                start: Start::Random,
                sampling: Sampling::Grid { stride: 64 },
                tile: 128,
                batch: 16,
                rate: Rate::NoiseScaled { factor: 0.01 },
                epochs: 20,
                denominator: Denominator::OtherHalf,
                influence: Influence::UNLIMITED,
                composition: Composition::MeanOfHalves,
                ..ours
            },
            // Few steps do better with less to learn: nine frames and four seeds, 0.98 of the error of three layers (0.99 across the
            // reference's halves) and 0.88 of the training time. (`balanced`, six frames: 1.00 and 0.87, of shots 1.01.)
            Preset::Fast => Settings { radius: SMALL_RADIUS, shape: Shape { layers: 2, ..ours.shape }, ..ours },
            Preset::Balanced => Settings { early_radius: SMALL_RADIUS, ..ours },
            // Over so many steps the noise of the tiles drawn most often would be learnt by heart; fewer
            // have no time to learn eight images. On a picture of 1280 x 720, twice the steps take off
            // another fiftieth of the error.
            Preset::Quality => Settings {
                sampling: Sampling::Uniform,
                diagonal: true,
                steps_grow_from: Some(QUALITY_STEPS_GROW_FROM),
                ..ours
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_influence_limit_rises_in_equal_ratios() {
        let limit = Influence { first: 1.0, last: 100.0 };
        for (done, expected) in [(0.0, 1.0), (0.5, 10.0), (1.0, 100.0)] {
            assert!((limit.at(done) / expected - 1.0).abs() < 1e-5, "{done}: {}", limit.at(done));
        }
        assert_eq!(Influence::constant(0.5).at(0.7), 0.5);
        assert_eq!(Influence::UNLIMITED.at(0.3), f32::INFINITY);
    }

    #[test]
    fn windows_grow_to_those_of_the_picture_and_no_further() {
        let of = |preset| [0.0, 0.79, 0.8, 1.0].map(|done| Settings::of(preset, 1).radius_at(done));
        assert_eq!(of(Preset::Balanced), [6, 6, 9, 9]);
        assert_eq!((of(Preset::Fast), of(Preset::Quality)), ([6; 4], [9; 4]));
        assert_eq!(of(Preset::Paper), [9; 4]);
        assert_eq!(Settings { radius: 3, ..Settings::of(Preset::Balanced, 1) }.radius_at(0.0), 3);
    }

    #[test]
    fn several_networks_share_the_time_of_a_preset() {
        let of = |preset, networks| Settings::of(preset, 1).shared_by(networks);
        assert_eq!(of(Preset::Balanced, 1), Settings::of(Preset::Balanced, 1));
        let balanced = of(Preset::Balanced, 3);
        assert_eq!((balanced.radius, balanced.early_radius, balanced.steps), (6, 4, 300));
        let quality = of(Preset::Quality, 3);
        assert_eq!((quality.radius, quality.steps, quality.sampling), (6, 800, Sampling::Important));
        assert_eq!(of(Preset::Paper, 3), Settings::of(Preset::Paper, 1), "the paper's form is untouched");
        let asked = Settings { changes: vec!["window=19".into()], ..Settings::of(Preset::Balanced, 1) };
        assert_eq!(asked.shared_by(3).radius, PAPER_RADIUS, "what was asked for stays");
    }

    #[test]
    fn the_paper_preset_keeps_the_papers_form() {
        let paper = Settings::of(Preset::Paper, 1);
        assert_eq!((paper.form, paper.shape.layers, paper.radius), (Form::Paper, 9, 9));
        assert_eq!((paper.influence, paper.denominator), (Influence::UNLIMITED, Denominator::OtherHalf));
        assert_eq!((paper.exposure, paper.composition), (Exposure::AsIs, Composition::MeanOfHalves));
    }
}
