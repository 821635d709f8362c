//! `--set KEY=VALUE`: a preset with single settings changed, for experiments and ablations.

use crate::combination::Combination;
use crate::preset::{Influence, LARGEST_RATE, Rate, Sampling, Settings, Skip, Start};
use sspc_core::composition::Composition;
use sspc_kernels::features::MAX_RADIUS;
use sspc_kernels::network::MAX_CHANNELS;
use sspc_kernels::parameters::Form;
use sspc_onnx::MAX_LAYERS;
use std::str::FromStr;

/// Smallest side of a window.
const MIN_WINDOW: usize = 3;
const MAX_WINDOW: usize = 2 * MAX_RADIUS + 1;
/// Smallest and largest side of a tile: below, borders decide; above, a step needs gigabytes.
const TILES: (usize, usize) = (8, 512);
const MAX_BATCH: usize = 256;

/// Every key and what it may be, as `--help` and messages show them.
pub const KEYS: [(&str, &str); 15] = [
    ("window", "side of the window of g_c in pixels, odd, 3 to 25"),
    ("early-window", "side of that window over the first four fifths of the steps, odd, 3 to 25"),
    ("hidden", "channels of a hidden layer, 1 to 16"),
    ("layers", "convolutions, 1 to 32"),
    ("combination", "gc, or fc (Deep Combiner's function)"),
    ("gate", "none (the paper's form), or the gate's start between 0 and 1"),
    ("influence", "limit on a pixel's gradient, above 0, the same at every step, or inf"),
    ("sampling", "uniform, or important (tiles where the denoised halves differ)"),
    ("tile", "side of a training tile in pixels, 8 to 512"),
    ("batch", "tiles a step, 1 to 256"),
    ("rate", "highest learning rate, above 0, at most 0.1"),
    ("skip", "all, none, blocks (still blocks only) or features (constant features only)"),
    ("composition", "judged, or halves (their mean, as in the paper)"),
    ("differences", "weight of differences of y that the renderer gives, 0 to 100, beside what their noise deserves"),
    ("held-out", "none, or blocks (one in eight is not trained on, and judges the picture)"),
];

/// A setting that cannot be changed in this way.
#[derive(Debug, PartialEq, thiserror::Error)]
#[expect(missing_docs, reason = "each message says what its fields are")]
pub enum Error {
    #[error("--set {found}: expected KEY=VALUE")]
    Form { found: String },

    #[error("--set {key}: no such setting; there are {}", KEYS.map(|(key, _)| key).join(", "))]
    Key { key: String },

    #[error("--set {key}={found}: expected {allowed}")]
    Value { key: &'static str, allowed: &'static str, found: String },

    #[error("--set {key} is given twice: {first} and {second}")]
    Twice { key: &'static str, first: String, second: String },

    #[error("--set {key}: {why}")]
    Conflict { key: &'static str, why: &'static str },
}

/// One setting and its new value, as given.
#[derive(Clone, Debug, PartialEq)]
pub struct Change {
    key: &'static str,
    allowed: &'static str,
    value: String,
}

impl FromStr for Change {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self, Error> {
        let (key, value) = text.split_once('=').ok_or_else(|| Error::Form { found: text.into() })?;
        let known = KEYS.iter().find(|(known, _)| *known == key);
        let &(key, allowed) = known.ok_or_else(|| Error::Key { key: key.into() })?;
        Ok(Change { key, allowed, value: value.into() })
    }
}

/// Applies `changes` (KEY=VALUE) to the settings of a preset; `from_model`: training starts from a
/// model, whose form and network stand.
///
/// # Errors
/// The first change that is unknown, out of range, given twice or against the preset or the model.
pub fn apply(changes: &[String], settings: &mut Settings, from_model: bool) -> Result<(), Error> {
    let mut done: Vec<Change> = Vec::new();
    for text in changes {
        let change: Change = text.parse()?;
        if let Some(first) = done.iter().find(|c| c.key == change.key) {
            return Err(Error::Twice { key: change.key, first: first.value.clone(), second: change.value });
        }
        if from_model
            && ["window", "early-window", "hidden", "layers", "combination", "gate", "composition"]
                .contains(&change.key)
        {
            return Err(change.conflict("the model of --init decides it"));
        }
        change.apply(settings)?;
        done.push(change);
    }
    settings.shape.outputs = settings.form.parameters();
    settings.changes.extend(changes.iter().cloned());
    Ok(())
}

impl Change {
    fn apply(&self, settings: &mut Settings) -> Result<(), Error> {
        match self.key {
            "window" => {
                let side = self.number(|side| side % 2 == 1 && (MIN_WINDOW..=MAX_WINDOW).contains(side))?;
                settings.radius = side / 2;
            }
            "early-window" => {
                let side = self.number(|side| side % 2 == 1 && (MIN_WINDOW..=MAX_WINDOW).contains(side))?;
                settings.early_radius = side / 2;
            }
            "hidden" => settings.shape.hidden = self.number(|n| (1..=MAX_CHANNELS).contains(n))?,
            "layers" => settings.shape.layers = self.number(|n| (1..=MAX_LAYERS).contains(n))?,
            "combination" => {
                settings.combination =
                    self.choice(&[("gc", Combination::PostCorrection), ("fc", Combination::DeepCombiner)])?;
            }
            "gate" => self.set_gate(settings)?,
            "influence" if self.value == "inf" => settings.influence = Influence::UNLIMITED,
            "influence" => {
                settings.influence = Influence::constant(self.number(|m: &f32| *m > 0.0 && m.is_finite())?);
            }
            "sampling" => {
                if matches!(settings.sampling, Sampling::Grid { .. }) {
                    return Err(self.conflict("this preset trains on a grid of patches"));
                }
                settings.sampling =
                    self.choice(&[("uniform", Sampling::Uniform), ("important", Sampling::Important)])?;
            }
            "tile" => settings.tile = self.number(|n| (TILES.0..=TILES.1).contains(n))?,
            "batch" => settings.batch = self.number(|n| (1..=MAX_BATCH).contains(n))?,
            "rate" => {
                let new = self.number(|r: &f64| *r > 0.0 && *r <= LARGEST_RATE)?;
                match &mut settings.rate {
                    Rate::Cosine { peak, .. } => *peak = new,
                    Rate::NoiseScaled { .. } => {
                        return Err(self.conflict("this preset takes its rate from the frame's noise"));
                    }
                }
            }
            "skip" => {
                settings.skip = self.choice(&[
                    ("all", Skip::ALL),
                    ("none", Skip { blocks: false, features: false }),
                    ("blocks", Skip { blocks: true, features: false }),
                    ("features", Skip { blocks: false, features: true }),
                ])?;
            }
            "differences" => {
                settings.difference_strength = self.number(|s: &f32| (0.0..=100.0).contains(s))?;
            }
            "held-out" => settings.held_out = self.choice(&[("none", false), ("blocks", true)])?,
            _ => {
                settings.composition =
                    self.choice(&[("judged", Composition::JudgedFullBuffer), ("halves", Composition::MeanOfHalves)])?;
            }
        }
        Ok(())
    }

    fn set_gate(&self, settings: &mut Settings) -> Result<(), Error> {
        if self.value == "none" {
            settings.form = Form::Paper;
            return Ok(());
        }
        let new = self.number(|s: &f64| *s > 0.0 && *s < 1.0)?;
        if settings.start == Start::Random {
            return Err(self.conflict("this preset starts from random weights, the gate's among them"));
        }
        settings.start = Start::Analytic { gate: new };
        settings.form = Form::Gated;
        Ok(())
    }

    fn number<T: FromStr>(&self, fits: impl Fn(&T) -> bool) -> Result<T, Error> {
        self.value.parse().ok().filter(fits).ok_or_else(|| self.refused())
    }

    fn choice<T: Copy>(&self, choices: &[(&str, T)]) -> Result<T, Error> {
        choices.iter().find(|(name, _)| *name == self.value).map(|(_, value)| *value).ok_or_else(|| self.refused())
    }

    fn refused(&self) -> Error {
        Error::Value { key: self.key, allowed: self.allowed, found: self.value.clone() }
    }

    fn conflict(&self, why: &'static str) -> Error {
        Error::Conflict { key: self.key, why }
    }
}

impl From<Error> for sspc_cli::Failure {
    fn from(error: Error) -> Self {
        Self::new(sspc_cli::Code::Arguments, error.to_string(), "")
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::preset::Preset;

    fn changed(preset: Preset, changes: &[&str]) -> Result<Settings, Error> {
        let mut settings = Settings::of(preset, 1);
        let changes: Vec<String> = changes.iter().map(|c| c.to_string()).collect();
        apply(&changes, &mut settings, false).map(|()| settings)
    }

    #[test]
    fn every_key_changes_its_setting_alone() {
        let own = || Settings::of(Preset::Balanced, 1);
        let small = |f: &dyn Fn(&mut Settings)| {
            let mut settings = own();
            f(&mut settings);
            settings
        };
        let cases: [(&str, Settings); 17] = [
            ("window=7", small(&|s| s.radius = 3)),
            ("window=25", small(&|s| s.radius = 12)),
            ("early-window=7", small(&|s| s.early_radius = 3)),
            ("hidden=1", small(&|s| s.shape.hidden = 1)),
            ("layers=4", small(&|s| s.shape.layers = 4)),
            ("combination=fc", small(&|s| s.combination = Combination::DeepCombiner)),
            ("gate=0.25", small(&|s| s.start = Start::Analytic { gate: 0.25 })),
            ("influence=inf", small(&|s| s.influence = Influence::UNLIMITED)),
            ("influence=0.5", small(&|s| s.influence = Influence::constant(0.5))),
            ("sampling=uniform", small(&|s| s.sampling = Sampling::Uniform)),
            ("tile=32", small(&|s| s.tile = 32)),
            ("batch=16", small(&|s| s.batch = 16)),
            ("rate=0.004", small(&|s| s.rate = Rate::Cosine { peak: 0.004, warm_up: 10 })),
            ("skip=blocks", small(&|s| s.skip = Skip { blocks: true, features: false })),
            ("composition=halves", small(&|s| s.composition = Composition::MeanOfHalves)),
            ("differences=0.5", small(&|s| s.difference_strength = 0.5)),
            ("held-out=blocks", small(&|s| s.held_out = true)),
        ];
        for (change, mut expected) in cases {
            expected.changes = vec![change.into()];
            assert_eq!(changed(Preset::Balanced, &[change]).expect(change), expected, "{change}");
        }
        assert_eq!(changed(Preset::Balanced, &[]), Ok(own()));
    }

    #[test]
    fn without_a_gate_the_network_has_the_papers_outputs() {
        let settings = changed(Preset::Balanced, &["hidden=8", "gate=none"]).expect("two changes");
        assert_eq!((settings.form, settings.shape.outputs, settings.shape.hidden), (Form::Paper, 15, 8));
    }

    #[test]
    fn a_wrong_value_is_told_what_is_allowed() {
        let wrong = [
            ("window", vec!["8", "1", "27", "-3", "x", ""]),
            ("early-window", vec!["8", "27", "x"]),
            ("hidden", vec!["0", "17", "1.5"]),
            ("layers", vec!["0", "33"]),
            ("combination", vec!["GC", "f_c"]),
            ("gate", vec!["0", "1", "nan", "off"]),
            ("influence", vec!["0", "-1", "nan", "1e39"]),
            ("sampling", vec!["random", "1"]),
            ("tile", vec!["7", "513"]),
            ("batch", vec!["0", "257"]),
            ("rate", vec!["0", "0.2", "nan", "inf"]),
            ("skip", vec!["some"]),
            ("composition", vec!["full"]),
            ("differences", vec!["-1", "101", "nan", "all"]),
            ("held-out", vec!["some"]),
        ];
        assert_eq!(wrong.len(), KEYS.len());
        for ((key, values), (known, allowed)) in wrong.iter().zip(KEYS) {
            assert_eq!(*key, known);
            for value in values {
                let expected = Error::Value { key: known, allowed, found: value.to_string() };
                assert_eq!(changed(Preset::Balanced, &[&format!("{key}={value}")]), Err(expected));
            }
        }
    }

    #[test]
    fn other_mistakes_have_messages_of_their_own() {
        let message = |preset, changes: &[&str]| changed(preset, changes).expect_err("a mistake").to_string();
        assert_eq!(message(Preset::Balanced, &["window"]), "--set window: expected KEY=VALUE");
        assert!(message(Preset::Balanced, &["size=3"]).contains("there are window, early-window, hidden"));
        let twice = message(Preset::Balanced, &["tile=32", "tile=64"]);
        assert!(twice.contains("twice: 32 and 64"), "{twice}");
        assert!(message(Preset::Paper, &["rate=0.01"]).contains("noise"));
        assert!(message(Preset::Paper, &["sampling=uniform"]).contains("grid"));
        assert!(message(Preset::Paper, &["gate=0.7"]).contains("random weights"));
        let with_model = apply(&["window=7".into()], &mut Settings::of(Preset::Balanced, 1), true);
        assert!(matches!(with_model, Err(Error::Conflict { key: "window", .. })));
    }
}
