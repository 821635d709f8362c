//! How visible the errors of a video are, flicker included: ColorVideoVDP, in just-objectionable differences (JOD).
//!
//! R. K. Mantiuk, P. Hanji, M. Ashraf, Y. Asano, A. Chapiro, "ColorVideoVDP: A Visual Difference Predictor for Image, Video
//! and Display Distortions", ACM Transactions on Graphics 43 (4), 2024. The crate predicts videos that are in memory as a
//! whole. Its temporal filters look back a quarter of a second and never ahead, so here a window of frames is predicted at a
//! time, of which the first give the others their past. The last sums, over frequencies, channels and frames, are therefore
//! made here.

use crate::displayed::Displayed;
use colorvideovdp::{Color, Cvvdp, DisplayModel, Image as Seen, Options, Prediction};
use std::fmt;

/// The display, by its name in ColorVideoVDP: 30 inches, 3840 x 2160, 200 cd/m², in an office, seen from twice its height, so
/// 75 pixels per degree.
pub const DISPLAY: &str = "standard_4k";
/// Version of the metric's calibration.
pub const MODEL: &str = Cvvdp::MODEL_VERSION;
/// Highest rate, frames per second.
pub const MOST_FRAMES_PER_SECOND: f32 = 240.0;
/// Fewest rows and columns that have a prediction.
pub const SMALLEST: usize = 4;
/// Fewest new frames of a window: where frames are slow, their past is short.
const SMALLEST_STEP: usize = 6;

/// Exponents of the norms over frequencies and channels, and over frames (the model's `beta_sch`, `beta_tch`, `beta_t`).
const OF_FRAME: f64 = 4.0;
const OF_FRAMES: f64 = 2.0;
/// Weights of the channels: achromatic, red-green, yellow-violet, and achromatic change (`ch_chrom_w`, `ch_trans_w`).
const CHANNELS: [f64; 4] = [1.0, 1.0, 1.0, 0.808_113_455_772_399_9];
/// Further weights of the lowest frequencies (`baseband_weight`).
const LOWEST: [f64; 4] =
    [0.003_633_448_621_258_139_6, 1.662_772_417_068_481_4, 4.118_745_326_995_85, 25.259_697_887_978_15];
/// From a difference to JOD (`jod_a`, `jod_exp`), linear below the smallest difference.
const JOD_FACTOR: f64 = 0.043_956_939_131_021_5;
const JOD_EXPONENT: f64 = 0.930_204_272_270_202_6;
const JOD_LINEAR: f64 = 0.1;
/// Keeps powers from an infinite slope at 0.
const NEAR_ZERO: f64 = 1e-5;

/// Why there is no prediction: memory ran out, or a number overflowed.
#[derive(Clone, Debug, PartialEq)]
pub struct NotPredicted(colorvideovdp::Error);

impl fmt::Display for NotPredicted {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(out, "ColorVideoVDP: {}", self.0)
    }
}

impl std::error::Error for NotPredicted {}

impl From<colorvideovdp::Error> for NotPredicted {
    fn from(error: colorvideovdp::Error) -> Self {
        Self(error)
    }
}

/// Videos of one scene against one reference, frame after frame.
pub struct Video {
    metric: Cvvdp,
    frames_per_second: f32,
    /// Frames of the window: of each video, and of the reference.
    pictures: Vec<Vec<Seen>>,
    reference: Vec<Seen>,
    /// Frames of the window that only the filters need, measured before.
    past: usize,
    /// Of each video, the visible difference of every frame so far.
    differences: Vec<Vec<f64>>,
}

impl Video {
    /// So many videos, shown at a rate above 0 and of at most [`MOST_FRAMES_PER_SECOND`].
    ///
    /// # Panics
    /// With another rate, or without a video.
    pub fn new(videos: usize, frames_per_second: f32) -> Self {
        assert!(videos > 0 && frames_per_second > 0.0 && frames_per_second <= MOST_FRAMES_PER_SECOND);
        let options = Options::default().with_memory_limit_bytes(usize::MAX);
        let display = DisplayModel::from_name(DISPLAY).expect("a display of the model");
        Self {
            metric: Cvvdp::new(display, options).expect("the model's own numbers"),
            frames_per_second,
            pictures: vec![Vec::new(); videos],
            reference: Vec::new(),
            past: 0,
            differences: vec![Vec::new(); videos],
        }
    }

    /// The next frame of each video, all against one reference and of the size of the frame before, at least [`SMALLEST`]
    /// on each side.
    ///
    /// # Errors
    /// [`NotPredicted`].
    ///
    /// # Panics
    /// When the number of videos or the size is another.
    pub fn push(&mut self, frame: &[Displayed]) -> Result<(), NotPredicted> {
        assert_eq!(frame.len(), self.pictures.len(), "a picture of each video");
        self.reference.push(interleaved(&frame[0].reference));
        for (pictures, displayed) in self.pictures.iter_mut().zip(frame) {
            pictures.push(interleaved(&displayed.picture));
        }
        let looked_back = self.looked_back();
        if self.reference.len() < looked_back + looked_back.max(SMALLEST_STEP) { Ok(()) } else { self.measure() }
    }

    /// Of each video the visible difference of every frame, 0 where there is none; empty for a single frame, which is no
    /// video.
    ///
    /// # Errors
    /// [`NotPredicted`].
    pub fn finish(mut self) -> Result<Vec<Vec<f64>>, NotPredicted> {
        if self.reference.len() > self.past.max(1) {
            self.measure()?;
        }
        Ok(self.differences)
    }

    /// Frames before a frame that its filters see.
    fn looked_back(&self) -> usize {
        2 * (0.125 * f64::from(self.frames_per_second)).ceil() as usize
    }

    /// Measures the new frames of the window and drops what no later frame needs.
    fn measure(&mut self) -> Result<(), NotPredicted> {
        let count = self.reference.len();
        for (pictures, differences) in self.pictures.iter().zip(&mut self.differences) {
            let prediction =
                self.metric.predict_video(pictures, &self.reference, self.frames_per_second, Color::Srgb)?;
            differences.extend((self.past..count).map(|frame| difference(&prediction, frame)));
        }
        self.past = self.looked_back().min(count);
        for frames in self.pictures.iter_mut().chain([&mut self.reference]) {
            frames.drain(..count - self.past);
        }
        Ok(())
    }
}

/// The quality in JOD of frames with these visible differences ([`Video::finish`]): 10 without any, and of two videos three of
/// four viewers choose the one that has 1 more; NaN without a frame.
pub fn jod(differences: &[f64]) -> f64 {
    let difference = norm(differences.iter().copied(), OF_FRAMES, differences.len());
    let slope = if difference <= JOD_LINEAR {
        JOD_LINEAR.powf(JOD_EXPONENT - 1.0)
    } else {
        difference.powf(JOD_EXPONENT - 1.0)
    };
    10.0 - JOD_FACTOR * slope * difference
}

/// The visible difference of a frame of a predicted window.
fn difference(prediction: &Prediction, frame: usize) -> f64 {
    let bands = prediction.band_frequencies.len();
    let of_channel = |channel: usize| {
        let start = (channel * prediction.frames + frame) * bands;
        let of_band = |band: usize| {
            let lowest = if band == bands - 1 { LOWEST[channel] } else { 1.0 };
            f64::from(prediction.quality_per_channel[start + band]) * CHANNELS[channel] * lowest
        };
        norm((0..bands).map(of_band), OF_FRAME, 1)
    };
    norm((0..CHANNELS.len()).map(of_channel), OF_FRAME, 1)
}

fn power(value: f64, exponent: f64) -> f64 {
    (value + NEAR_ZERO).powf(exponent) - NEAR_ZERO.powf(exponent)
}

fn norm(values: impl Iterator<Item = f64>, exponent: f64, count: usize) -> f64 {
    let sum: f64 = values.map(|value| power(value, exponent)).sum();
    power(sum / count as f64, 1.0 / exponent)
}

fn interleaved(picture: &sspc_image::Image) -> Seen {
    let planes = [0, 1, 2].map(|c| picture.plane(c));
    let data = (0..picture.pixels()).flat_map(|i| planes.map(|plane| plane[i])).collect();
    Seen::new(picture.width(), picture.height(), 3, data).expect("a picture that is large enough")
}

#[cfg(test)]
mod tests {
    use super::*;
    use sspc_image::Image;

    const SIZE: (usize, usize) = (24, 33);
    /// f32 sums of the crate against f64 sums here.
    const ROUNDING: f64 = 2e-5;

    /// A moving texture, and the same with an error of this strength, whose place changes from frame to frame.
    fn frame(number: usize, strength: f32) -> Displayed {
        let at = |c: usize, y: usize, x: usize| {
            0.2 + 0.1 * ((x + 2 * number) as f32 * 0.7 + (y * (c + 1)) as f32 * 0.3).sin()
        };
        let reference = Image::from_fn(3, SIZE.0, SIZE.1, at);
        let wrong = |y: usize, x: usize| strength * ((x * 7 + y * 13 + number * 29) % 11) as f32 / 11.0;
        let picture = Image::from_fn(3, SIZE.0, SIZE.1, |c, y, x| at(c, y, x) + wrong(y, x));
        Displayed::new(&picture, &reference, 1.0)
    }

    fn differences(frames: Vec<Displayed>, rate: f32) -> Vec<f64> {
        let mut video = Video::new(1, rate);
        frames.iter().for_each(|frame| video.push(std::slice::from_ref(frame)).expect("a prediction"));
        video.finish().expect("a prediction").swap_remove(0)
    }

    fn whole(frames: &[Displayed], rate: f32) -> Prediction {
        let [pictures, reference] =
            [|f: &Displayed| interleaved(&f.picture), |f: &Displayed| interleaved(&f.reference)]
                .map(|of| frames.iter().map(of).collect::<Vec<_>>());
        Video::new(1, rate).metric.predict_video(&pictures, &reference, rate, Color::Srgb).expect("a prediction")
    }

    #[test]
    fn windows_give_what_the_whole_video_gives() {
        // At 24 frames per second a window holds 12 frames, at 5 it holds 8.
        for (rate, counts) in [(24.0, [2, 12, 13, 31]), (5.0, [3, 8, 9, 20])] {
            for count in counts {
                let frames: Vec<_> = (0..count).map(|number| frame(number, 0.02 * (number % 3) as f32)).collect();
                let whole = whole(&frames, rate);
                let found = differences(frames, rate);
                assert_eq!(found.len(), count);
                for (number, own) in found.iter().enumerate() {
                    let expected = difference(&whole, number);
                    assert!(
                        (own - expected).abs() < 1e-6,
                        "frame {number} of {count} at {rate}: {own}, not {expected}"
                    );
                }
                assert!((jod(&found) - f64::from(whole.jod)).abs() < ROUNDING, "{} {}", jod(&found), whole.jod);
            }
        }
    }

    #[test]
    fn ten_without_a_difference_and_less_the_more_there_is() {
        let of = |strength: f32| jod(&differences((0..8).map(|number| frame(number, strength)).collect(), 24.0));
        assert_eq!(of(0.0), 10.0);
        let (weak, strong) = (of(0.01), of(0.1));
        assert!(10.0 > weak && weak > strong && strong > 5.0, "{weak} {strong}");
    }

    #[test]
    fn an_error_that_comes_and_goes_is_seen_more_than_one_that_stays() {
        let of = |is_wrong: fn(usize) -> bool| {
            let reference = Image::filled(3, 16, 16, 0.2);
            let frames = (0..8).map(|n| {
                Displayed::new(&Image::filled(3, 16, 16, if is_wrong(n) { 0.21 } else { 0.2 }), &reference, 1.0)
            });
            jod(&differences(frames.collect(), 24.0))
        };
        let (stays, flickers) = (of(|_| true), of(|number| number % 3 == 0));
        assert!(flickers < stays - 0.1, "{flickers} {stays}");
    }

    #[test]
    fn a_single_frame_is_no_video() {
        assert!(differences(vec![frame(0, 0.1)], 24.0).is_empty());
        assert!(jod(&[]).is_nan());
    }
}
