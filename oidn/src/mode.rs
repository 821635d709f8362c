//! Which features guide the denoiser, and how long it may take.

use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// Which features guide the denoiser. Which is best changes from scene to scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Mode {
    /// Albedo and normal as rendered.
    Aux,
    /// Albedo and normal denoised by themselves first, then declared clean.
    CleanAux,
    /// Colour alone.
    Colour,
}

/// How much time the denoiser takes for its picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Quality {
    /// A small network (OIDN 2.3 or later).
    Fast,
    /// A smaller network than the largest (OIDN 2.2 or later).
    Balanced,
    /// The largest network.
    High,
}

impl Mode {
    /// All modes.
    pub const ALL: [Mode; 3] = [Mode::Aux, Mode::CleanAux, Mode::Colour];

    /// Its name on command lines and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Mode::Aux => "aux",
            Mode::CleanAux => "clean-aux",
            Mode::Colour => "colour",
        }
    }

    /// What it comes to for a picture with or without albedo: without, nothing but colour can guide.
    pub fn with(self, albedo: bool) -> Mode {
        if albedo { self } else { Mode::Colour }
    }
}

impl Quality {
    /// All qualities, the fastest first.
    pub const ALL: [Quality; 3] = [Quality::Fast, Quality::Balanced, Quality::High];

    /// Its name on command lines and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Quality::Fast => "fast",
            Quality::Balanced => "balanced",
            Quality::High => "high",
        }
    }

    /// Its number in OIDN's interface (`OIDNQuality`).
    pub(crate) fn number(self) -> i32 {
        match self {
            Quality::Fast => 4,
            Quality::Balanced => 5,
            Quality::High => 6,
        }
    }
}

impl fmt::Display for Mode {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.name())
    }
}

impl fmt::Display for Quality {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(self.name())
    }
}

impl FromStr for Mode {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let name = if text == "color" { "colour" } else { text };
        let known = Mode::ALL.into_iter().find(|mode| mode.name() == name);
        known.ok_or_else(|| format!("expected {}, found '{text}'", Mode::ALL.map(Mode::name).join(", ")))
    }
}

impl FromStr for Quality {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Quality::ALL.into_iter().find(|quality| quality.name() == text);
        known.ok_or_else(|| format!("expected {}, found '{text}'", Quality::ALL.map(Quality::name).join(", ")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for mode in Mode::ALL {
            assert_eq!(mode.name().parse(), Ok(mode));
        }
        for quality in Quality::ALL {
            assert_eq!(quality.name().parse(), Ok(quality));
        }
        assert_eq!("color".parse(), Ok(Mode::Colour));
        assert_eq!("albedo".parse::<Mode>(), Err("expected aux, clean-aux, colour, found 'albedo'".into()));
        assert!("best".parse::<Quality>().is_err());
        assert_eq!(Mode::CleanAux.with(false), Mode::Colour);
    }
}
