//! What a renderer's motion pass means.
//!
//! Names and documents don't tell: vectors point to the previous or to the next frame, in pixels or shares of the screen,
//! upwards or downwards. So the few readings are tried: each gives a field, along which the neighbour's albedo and normal
//! (z without any) are laid over the frame's own. The reading with the least error is taken, when that is clearly less than
//! the error without any motion.

use crate::field::Field;
use crate::flow::brightness;
use crate::validity::Guides;
use crate::warp::{Taps, bilinear};
use rayon::prelude::*;
use serde::Serialize;
use sspc_image::Image;
use std::fmt;
use std::str::FromStr;

/// A reading must have at most this share of the error without motion.
const DECISIVE: f64 = 0.9;
/// Pixels at which readings are compared, about.
const LOOKED_AT: usize = 20_000;
/// A pixel's error is at most this for each feature, so that disocclusions don't decide.
const LARGEST_ERROR: f32 = 1.0;
/// A pixel that a reading leads out of the picture counts as so far off.
const OUTSIDE_ERROR: f32 = 1.0;
/// Two readings this near, relatively, are as good as each other: the earlier in the list is taken.
const AS_GOOD: f64 = 1.02;

/// Mean error of what comes into view and has no place in the neighbour: an estimate finds something alike for it. Estimates
/// also follow noise, to 0.93 of the error of exact motion.
const COMES_INTO_VIEW: f64 = 0.02;

/// What one unit of a motion pass is.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Unit {
    /// A pixel: Cycles, Arnold, RenderMan, Nuke.
    Pixel,
    /// Half the picture, -1..1 from side to side: MoonRay.
    HalfScreen,
    /// The whole picture.
    Screen,
    /// So many pixels, and 0.5 is no motion: V-Ray and others that write motion as a colour.
    Colour(f32),
}

/// How a motion pass leads to one neighbour: the neighbour's (x, y) is the frame's plus sign · unit · (component - zero).
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Convention {
    /// First of the two components in use, 0 or 2.
    pub first: usize,
    /// The unit.
    pub unit: Unit,
    /// Sign of the first component, to the right.
    pub right: i8,
    /// Sign of the second component, downwards.
    pub down: i8,
}

/// Names of components in messages.
const NAMES: [char; 4] = ['X', 'Y', 'Z', 'W'];

impl fmt::Display for Convention {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let sign = |sign: i8| if sign < 0 { '-' } else { '+' };
        let (right, down) = (sign(self.right), sign(self.down));
        write!(out, "{right}{} {down}{} ", NAMES[self.first], NAMES[self.first + 1])?;
        match self.unit {
            Unit::Pixel => out.write_str("pixels"),
            Unit::HalfScreen => out.write_str("half-screens"),
            Unit::Screen => out.write_str("screens"),
            Unit::Colour(pixels) => write!(out, "{pixels}-pixels-around-grey"),
        }
    }
}

impl FromStr for Convention {
    type Err = String;

    /// Reads what `Display` writes.
    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = || format!("expected a reading of motion such as '+X -Y pixels', found '{text}'");
        let mut words = text.split(' ');
        let component = |word: Option<&str>| {
            let mut signs = word?.chars();
            let sign = match signs.next()? {
                '+' => 1,
                '-' => -1,
                _ => return None,
            };
            let at = NAMES.iter().position(|name| Some(*name) == signs.clone().next())?;
            (signs.count() == 1).then_some((sign, at))
        };
        let (right, first) = component(words.next()).ok_or_else(wrong)?;
        let (down, second) = component(words.next()).ok_or_else(wrong)?;
        let unit = match words.next().ok_or_else(wrong)? {
            "pixels" => Unit::Pixel,
            "half-screens" => Unit::HalfScreen,
            "screens" => Unit::Screen,
            other => {
                let pixels = other.strip_suffix("-pixels-around-grey").and_then(|number| number.parse::<f32>().ok());
                Unit::Colour(pixels.filter(|pixels| pixels.is_finite() && *pixels > 0.0).ok_or_else(wrong)?)
            }
        };
        let is_pair = matches!((first, second), (0, 1) | (2, 3)) && words.next().is_none();
        if is_pair { Ok(Self { first, unit, right, down }) } else { Err(wrong()) }
    }
}

impl Convention {
    /// Pixels to the right and downwards of one unit of each component, and the value that is no motion.
    fn scale(&self, height: usize, width: usize) -> (f32, f32, f32) {
        let (right, down, zero) = match self.unit {
            Unit::Pixel => (1.0, 1.0, 0.0),
            Unit::HalfScreen => (0.5 * width as f32, 0.5 * height as f32, 0.0),
            Unit::Screen => (width as f32, height as f32, 0.0),
            Unit::Colour(pixels) => (pixels, pixels, 0.5),
        };
        (f32::from(self.right) * right, f32::from(self.down) * down, zero)
    }

    /// The field of a motion pass `[2.., H, W]`; values that are not finite lead nowhere.
    ///
    /// # Panics
    /// When the pass lacks a component.
    pub fn field(&self, motion: &Image) -> Field {
        let (height, width) = (motion.height(), motion.width());
        let (right, down, zero) = self.scale(height, width);
        Image::from_rows(2, height, width, |c, y, row| {
            let scale = if c == 0 { right } else { down };
            for (out, value) in row.iter_mut().zip(motion.row(self.first + c, y)) {
                *out = scale * (value - zero);
            }
        })
    }
}

/// The readings of a pass of some components, the likeliest first.
fn readings(motion: &Image) -> Vec<Convention> {
    let pairs: &[usize] = if motion.channels() >= 4 { &[0, 2] } else { &[0] };
    let (height, width) = (motion.height(), motion.width());
    let mut units = vec![Unit::Pixel, Unit::HalfScreen, Unit::Screen];
    if is_colour(motion) {
        let most = 4 * height.max(width);
        // Powers of √2; the error of a field that is a fifth too long is far below that of none.
        units.extend((2..).map(|k| 2f32.powf(0.5 * k as f32)).take_while(|s| *s <= most as f32).map(Unit::Colour));
    }
    let signs = [(1, -1), (-1, 1), (1, 1), (-1, -1)];
    let of_unit = |unit: &Unit| {
        let unit = *unit;
        let of_pair =
            move |first: &usize| signs.map(|(right, down)| Convention { first: *first, unit, right, down }).to_vec();
        pairs.iter().flat_map(of_pair).collect::<Vec<_>>()
    };
    units.iter().flat_map(of_unit).collect()
}

/// Whether a pass is motion around grey: within 0..1, and one half in the middle.
fn is_colour(motion: &Image) -> bool {
    let mut values: Vec<f32> = motion.plane(0).iter().chain(motion.plane(1)).step_by(7).copied().collect();
    values.retain(|value| value.is_finite());
    values.sort_unstable_by(f32::total_cmp);
    let [Some(low), Some(middle), Some(high)] =
        [values.first(), values.get(values.len() / 2), values.last()].map(|value| value.copied())
    else {
        return false;
    };
    low >= 0.0 && high <= 1.0 && high > low && (0.25..0.75).contains(&middle)
}

/// What is laid over each other: features, else the logarithm of z.
pub struct Alignment<'a> {
    pairs: Vec<(f32, &'a Image, &'a Image)>,
}

impl<'a> Alignment<'a> {
    /// Features that both have.
    pub fn of(centre: &Guides<'a>, neighbour: &Guides<'a>) -> Self {
        Self { pairs: centre.pairs(neighbour) }
    }

    /// By pictures alone, `[3, H, W]` of about the same brightness in both frames.
    pub fn of_pictures(centre: &'a Image, neighbour: &'a Image) -> Self {
        let mean = brightness(centre);
        Self { pairs: vec![(1.0 / (mean * mean), centre, neighbour)] }
    }

    /// Whether there is anything to lay over each other.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty()
    }

    /// Whether a field that is exact for what stands still does not lay features over each other clearly worse than an
    /// estimated one, over the pixels that both lead to.
    ///
    /// # Panics
    /// When sizes differ.
    pub fn is_as_good(&self, field: &Field, estimated: &Field) -> bool {
        assert!(field.same_size(estimated), "fields of one size");
        let (height, width) = (field.height(), field.width());
        let lead = |at: usize| {
            let (x, y) = ((at % width) as f32, (at / width) as f32);
            let inside = |to: &Field| Taps::at(x + to.plane(0)[at], y + to.plane(1)[at], height, width).is_some();
            inside(field) && inside(estimated)
        };
        let error = |of: &Field| {
            let displacement = |at: usize| lead(at).then(|| (of.plane(0)[at], of.plane(1)[at]));
            let (sum, count) = self.error_where(displacement, height, width);
            if count > 0.0 { sum / count } else { 0.0 }
        };
        DECISIVE * error(field) <= error(estimated) + COMES_INTO_VIEW
    }

    /// Error and count of pixels that a displacement leads to, over a grid of pixels; pixels without a finite value on
    /// either side count for nothing.
    fn error(&self, displacement: impl Fn(usize) -> (f32, f32) + Sync, height: usize, width: usize) -> (f64, f64) {
        self.error_where(|at| Some(displacement(at)), height, width)
    }

    /// The same over the pixels that have a displacement.
    fn error_where(
        &self,
        displacement: impl Fn(usize) -> Option<(f32, f32)> + Sync,
        height: usize,
        width: usize,
    ) -> (f64, f64) {
        let stride = ((height * width) as f64 / LOOKED_AT as f64).sqrt().ceil().max(1.0) as usize;
        let rows: Vec<usize> = (stride / 2..height).step_by(stride).collect();
        let of_row = |&y: &usize| {
            let (mut sum, mut count) = (0.0f64, 0.0f64);
            for x in (stride / 2..width).step_by(stride) {
                let Some((dx, dy)) = displacement(y * width + x) else { continue };
                let error = match Taps::at(x as f32 + dx, y as f32 + dy, height, width) {
                    Some(taps) => self.of_pixel(y * width + x, width, &taps),
                    None => OUTSIDE_ERROR * self.pairs.len() as f32,
                };
                if error.is_finite() {
                    sum += f64::from(error);
                    count += 1.0;
                }
            }
            (sum, count)
        };
        // Summed in order, whatever the number of threads.
        let sums: Vec<(f64, f64)> = rows.par_iter().with_min_len(16).map(of_row).collect();
        sums.iter().fold((0.0, 0.0), |all, row| (all.0 + row.0, all.1 + row.1))
    }

    fn of_pixel(&self, at: usize, width: usize, taps: &Taps) -> f32 {
        let of_pair = |(weight, own, other): &(f32, &Image, &Image)| {
            let squares = (0..own.channels()).map(|c| {
                let apart = own.plane(c)[at] - bilinear(other.plane(c), width, taps);
                apart * apart
            });
            let error = weight * squares.sum::<f32>();
            // NaN stays NaN.
            if error > LARGEST_ERROR { LARGEST_ERROR } else { error }
        };
        self.pairs.iter().map(of_pair).sum()
    }
}

/// The evidence for a reading.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Evidence {
    /// The best reading.
    pub best: Convention,
    /// Its error, a mean over pixels.
    pub error: f64,
    /// The error without any motion.
    pub still: f64,
    /// The error of the best reading with both signs turned.
    pub opposite: f64,
}

impl Evidence {
    /// Whether the best reading is clearly better than no motion.
    pub fn is_decisive(&self) -> bool {
        self.error <= DECISIVE * self.still
    }
}

impl fmt::Display for Evidence {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Evidence { best, error, still, opposite } = self;
        write!(
            out,
            "{best}: features {error:.3} apart along it, {still:.3} without motion, {opposite:.3} the other way"
        )
    }
}

/// The search for the reading of a pass that leads to one neighbour (the previous frames, or the next), over any number of
/// frames.
#[derive(Clone, Debug, Default)]
pub struct ConventionSearch {
    still: (f64, f64),
    readings: Vec<(Convention, f64, f64)>,
}

impl ConventionSearch {
    /// Looks at a frame's pass `[2.., H, W]` and what is to be aligned with its neighbour.
    pub fn look(&mut self, motion: &Image, alignment: &Alignment) {
        let (height, width) = (motion.height(), motion.width());
        let add = |sums: (f64, f64), found: (f64, f64)| (sums.0 + found.0, sums.1 + found.1);
        self.still = add(self.still, alignment.error(|_| (0.0, 0.0), height, width));
        if self.readings.is_empty() {
            self.readings = readings(motion).into_iter().map(|reading| (reading, 0.0, 0.0)).collect();
        }
        for (reading, sum, count) in &mut self.readings {
            if reading.first + 1 >= motion.channels() {
                continue;
            }
            let (right, down, zero) = reading.scale(height, width);
            let [dx, dy] = [0, 1].map(|c| motion.plane(reading.first + c));
            let found = alignment.error(|at| (right * (dx[at] - zero), down * (dy[at] - zero)), height, width);
            (*sum, *count) = add((*sum, *count), found);
        }
    }

    /// What was found; `None` where nothing was looked at.
    pub fn finish(&self) -> Option<Evidence> {
        let mean = |(sum, count): (f64, f64)| if count > 0.0 { sum / count } else { f64::INFINITY };
        let errors: Vec<(Convention, f64)> =
            self.readings.iter().map(|(reading, sum, count)| (*reading, mean((*sum, *count)))).collect();
        let least = errors.iter().map(|found| found.1).fold(f64::INFINITY, f64::min);
        let (best, error) = *errors.iter().find(|found| found.1 <= AS_GOOD * least)?;
        let turned = Convention { right: -best.right, down: -best.down, ..best };
        let opposite = errors.iter().find(|found| found.0 == turned).map_or(f64::INFINITY, |found| found.1);
        Some(Evidence { best, error, still: mean(self.still), opposite })
    }
}

/// Whether a reading that was found elsewhere holds for this frame as well: it is not worse than no motion.
pub fn holds(reading: &Convention, motion: &Image, alignment: &Alignment) -> bool {
    let (height, width) = (motion.height(), motion.width());
    if reading.first + 1 >= motion.channels() || alignment.is_empty() {
        return reading.first + 1 < motion.channels();
    }
    let (right, down, zero) = reading.scale(height, width);
    let [dx, dy] = [0, 1].map(|c| motion.plane(reading.first + c));
    let mean = |(sum, count): (f64, f64)| if count > 0.0 { sum / count } else { f64::INFINITY };
    let along = mean(alignment.error(|at| (right * (dx[at] - zero), down * (dy[at] - zero)), height, width));
    let still = mean(alignment.error(|_| (0.0, 0.0), height, width));
    along <= still.max(f64::from(f32::EPSILON)) * AS_GOOD
}

/// Whether a pass says nothing: the same value at every pixel, or nothing finite.
pub fn says_nothing(motion: &Image) -> bool {
    (0..motion.channels()).all(|c| {
        let mut values = motion.plane(c).iter().filter(|value| value.is_finite());
        values.next().is_none_or(|first| values.all(|value| value == first))
    })
}
