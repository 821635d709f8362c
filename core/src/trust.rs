//! What is done about halves whose noise is not independent: no correction at all.
//!
//! A firefly that both halves share looks true to either, so with a correlation of 0.3 pictures come out up to 2.6 times
//! worse than the denoiser's, some with 0.1. A negative one makes them trust y too much: 1.7 times at -0.3. The
//! denoiser's picture is the answer then, aloud.

use crate::alignment::Alignment;
use crate::frame_stats::FrameStats;
use crate::independence::Independence;
use std::fmt;

/// Correlations between these are left alone: independent halves were measured from -0.04 to 0.05. (At 0.09, 0.05 of it
/// injected, a frame of little gain came out at 1.03 of the denoiser's error.)
pub const NEGLIGIBLE: (f64, f64) = (-0.08, 0.07);
/// Correlations up to this are left alone where texture is at work. (Fine leaves at 64 samples a pixel give 0.18 and more; a
/// half that is the full buffer, 0.33 under fireflies.)
pub const NEGLIGIBLE_BESIDE_TEXTURE: f64 = 0.2;
/// Difference of the halves' brightness, as a share of it, beyond which they are not of one exposure.
pub const BRIGHTNESS_DIFFERS: f64 = 0.08;
/// Energy of one half's residual over the other's, beyond what their samples explain, from which on one of them is no render:
/// a filter takes away more.
pub const NOISE_DIFFERS: f64 = 12.0;
/// The same from which on halves of unknown samples are said to differ in them. (On frames of 1:1 and 4:1 samples the ratio was
/// within 16 % of theirs, on frames of 12:1 within 35 %.)
pub const SAMPLES_DIFFER: f64 = 2.0;
/// Correlation of the halves' edges of albedo and normal between cells below which they are of different pictures, where
/// none is seen between pixels.
pub const EDGES_DIFFER: f64 = 0.3;

/// What may be made of a frame's halves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Trust {
    /// They are what they claim to be, as far as can be told.
    Independent,
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
    /// Half b lies so many pixels to the right of and below half a.
    Moved([i32; 2]),
}

impl Trust {
    /// The answer to what was measured.
    pub fn of(found: &Independence) -> Self {
        if let Some(distrust) = different_pictures(found) {
            return Trust::None(distrust);
        }
        let Some(r) = found.correlation else { return Trust::Independent };
        if r + found.standard_error < NEGLIGIBLE.0 {
            return Trust::None(Distrust::Correlated(r));
        }
        let most = if found.textured { NEGLIGIBLE_BESIDE_TEXTURE } else { NEGLIGIBLE.1 };
        if r - found.standard_error <= most { Trust::Independent } else { Trust::None(Distrust::Correlated(r)) }
    }

    /// What a person should know.
    pub fn warning(self) -> Option<String> {
        match self {
            Trust::Independent => None,
            Trust::None(distrust) => Some(distrust.to_string()),
        }
    }
}

fn different_pictures(found: &Independence) -> Option<Distrust> {
    if let Some(Alignment { seen, cells, offset, .. }) = found.alignment {
        if offset != [0, 0] {
            return Some(Distrust::Moved(offset));
        }
        if !seen && cells < EDGES_DIFFER {
            return Some(Distrust::Edges(cells));
        }
    }
    // Texture that both denoised pictures lack brings the ratio nearer to 1.
    let expected = found.expected_noise_ratio;
    let explained = expected.min(1.0) / NOISE_DIFFERS..=expected.max(1.0) * NOISE_DIFFERS;
    if !explained.contains(&found.noise_ratio) {
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
                "half a differs from its denoised picture by {ratio:.3} times the energy of half b, more than {NOISE_DIFFERS} times what their samples explain: one of them is filtered or denoised already"
            ),
            Distrust::Edges(r) => write!(
                f,
                "the edges of the halves' albedo and normal lie in different places (correlation {r:.2}, expected above {EDGES_DIFFER}): they are of different frames or geometry"
            ),
            Distrust::Moved([right, down]) => write!(
                f,
                "half b lies {right:+} pixels to the right of half a and {down:+} below it, by the edges of albedo and normal: render both with one camera and window"
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

#[cfg(test)]
mod tests {
    use super::*;

    fn independent() -> Independence {
        Independence {
            correlation: Some(0.01),
            standard_error: 0.01,
            noise_ratio: 1.1,
            brightness: [1.01, 0.99, 1.0],
            alignment: Some(Alignment { edges: 0.8, seen: true, cells: 0.9, offset: [0, 0] }),
            ..Independence::default()
        }
    }

    #[test]
    fn independent_halves_are_trusted_up_to_the_limits_and_doubted_beyond() {
        let of = |change: &dyn Fn(&mut Independence)| {
            let mut found = independent();
            change(&mut found);
            Trust::of(&found)
        };
        assert_eq!(of(&|_| ()), Trust::Independent);
        assert_eq!(of(&|f| f.correlation = None), Trust::Independent);
        assert_eq!(of(&|f| f.alignment = None), Trust::Independent);
        let correlated = |r: f64| of(&|f| f.correlation = Some(r));
        assert_eq!([0.07, -0.08].map(correlated), [Trust::Independent; 2]);
        assert_eq!([0.09, -0.1, 0.9].map(correlated), [0.09, -0.1, 0.9].map(|r| Trust::None(Distrust::Correlated(r))));
        let textured = |r: f64| {
            of(&|f| {
                f.correlation = Some(r);
                f.textured = true;
            })
        };
        assert_eq!([0.15, 0.2].map(textured), [Trust::Independent; 2]);
        assert_eq!(textured(0.3), Trust::None(Distrust::Correlated(0.3)));
        let aligned = |seen, cells, offset| of(&|f| f.alignment = Some(Alignment { edges: 0.1, seen, cells, offset }));
        assert_eq!(aligned(false, 0.2, [0, 0]), Trust::None(Distrust::Edges(0.2)));
        assert_eq!([aligned(true, 0.2, [0, 0]), aligned(false, 0.5, [0, 0])], [Trust::Independent; 2]);
        assert_eq!(aligned(true, 0.8, [0, 1]), Trust::None(Distrust::Moved([0, 1])));
        assert_eq!([4.0, 0.25].map(|ratio| of(&|f| f.noise_ratio = ratio)), [Trust::Independent; 2]);
        assert_eq!(
            [13.0, 0.05].map(|r| of(&|f| f.noise_ratio = r)),
            [13.0, 0.05].map(|r| Trust::None(Distrust::Noise(r)))
        );
        let of_samples =
            |expected: f64, ratio: f64| of(&|f| (f.expected_noise_ratio, f.noise_ratio) = (expected, ratio));
        assert_eq!([(0.05, 0.05), (20.0, 20.0), (20.0, 1.0)].map(|(e, r)| of_samples(e, r)), [Trust::Independent; 3]);
        assert_eq!(of_samples(0.05, 13.0), Trust::None(Distrust::Noise(13.0)));
        assert_eq!(of(&|f| f.brightness[2] = 0.9), Trust::None(Distrust::Brightness(2, 0.9)));
        assert_eq!(of(&|f| f.brightness[1] = 1.05), Trust::Independent);
    }

    #[test]
    fn a_warning_says_what_was_found_and_what_to_do() {
        let text = Trust::None(Distrust::Brightness(0, 1.5)).warning().unwrap();
        assert!(
            text.contains("1.500 times as bright") && text.contains("red") && text.contains("one exposure"),
            "{text}"
        );
        let text = Trust::None(Distrust::Correlated(-0.4)).warning().unwrap();
        assert!(text.contains("-0.40") && text.contains("independent seeds"), "{text}");
        assert_eq!(Trust::Independent.warning(), None);
    }
}
