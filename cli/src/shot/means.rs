//! A frame's temporal means: motion, validity, warped sums, of each half from its own pictures and of the full buffer.

use super::report::NeighbourReport;
use super::settings::{MotionSearch, ShotSettings};
use super::side::{Decoded, Side, Sides};
use crate::failure::Failure;
use sspc_frames::error::Error;
use sspc_image::{DenoisedVariant, Image};
use sspc_shots::camera::moved;
use sspc_shots::convention::{Alignment, Convention, holds, says_nothing};
use sspc_shots::field::{Field, composed, of_full};
use sspc_shots::flow::estimated;
use sspc_shots::light::keep_same;
use sspc_shots::mean::TemporalMean;
use sspc_shots::relation::{
    LEAST_LIKENESS, LEAST_VALIDITY, MOST_SHARED_NOISE, Noisy, are_same, likeness, shared_noise,
};
use sspc_shots::validity::{Guides, validity};
use std::borrow::Cow;

/// Rows in the middle of the picture over which noise is correlated.
const ROWS_LOOKED_AT: usize = 256;

/// A frame beside another.
pub struct Neighbour {
    /// Its number.
    pub number: i32,
    /// Its number from that of the frame.
    pub offset: i32,
    /// Its buffers; nothing where it has no files.
    pub sides: Result<Option<Sides>, Failure>,
}

/// What the neighbours give to a frame.
pub struct Means {
    /// The means in the place of the frame's variants; `None` where no neighbour adds anything.
    pub variants: Option<Vec<DenoisedVariant>>,
    /// What was done with each.
    pub reports: Vec<NeighbourReport>,
    /// What a person should know.
    pub warnings: Vec<String>,
}

/// One half's way to a neighbour.
struct Way {
    field: Field,
    valid: Image,
}

/// The means of a frame over its neighbours, the nearest of each side before those beyond it.
///
/// # Errors
/// What reading the frame itself can raise.
pub fn of_frame(centre: &Sides, neighbours: &[Neighbour], settings: &ShotSettings) -> Result<Means, Error> {
    let mut work = Work::new(centre, settings);
    let mut found = Means { variants: None, reports: Vec::new(), warnings: Vec::new() };
    for at in 0..neighbours.len() {
        let (nearer, rest) = neighbours.split_at(at);
        let neighbour = &rest[0];
        let sides = match &neighbour.sides {
            Ok(Some(sides)) => sides,
            Ok(None) => continue,
            Err(failure) => {
                let why = &failure.message;
                found.warnings.push(format!("the neighbouring frame {} is left out: {why}", neighbour.number));
                continue;
            }
        };
        let step = neighbour.offset.signum();
        let before = nearer.iter().find(|other| other.offset == neighbour.offset - step);
        let before = before.and_then(|other| other.sides.as_ref().ok()?.as_ref());
        let outcome = work.add(sides, before, neighbour.offset);
        let (motion, validity, left_out) = match outcome {
            Ok(added) => (added.motion, added.validity, added.left_out),
            Err(error) => {
                found.warnings.push(format!("the neighbouring frame {} is left out: {error}", neighbour.number));
                continue;
            }
        };
        if let Some(why) = left_out.as_ref().filter(|why| why.is_warning) {
            found.warnings.push(format!("the neighbouring frame {} is left out: {}", neighbour.number, why.text));
        }
        let left_out = left_out.map(|why| why.text);
        found.reports.push(NeighbourReport { frame: neighbour.number, motion, validity, left_out });
    }
    found.variants = work.finish()?;
    Ok(found)
}

/// Why a neighbour was left out.
struct LeftOut {
    text: String,
    is_warning: bool,
}

/// What became of a neighbour.
struct Added {
    motion: Option<String>,
    validity: f64,
    left_out: Option<LeftOut>,
}

/// The sums of a frame's means. One half of the frame and of a neighbour are in memory at a time.
struct Work<'a> {
    centre: &'a Sides,
    settings: &'a ShotSettings,
    /// Of half a, of half b and of the full buffer; `None` as long as nothing was added.
    sums: Option<[TemporalMean; 3]>,
    /// Fields of each half to the farthest neighbours so far, before and after the frame, where there are farther ones.
    ways: [Option<[Field; 2]>; 2],
}

impl<'a> Work<'a> {
    fn new(centre: &'a Sides, settings: &'a ShotSettings) -> Self {
        Self { centre, settings, sums: None, ways: [None, None] }
    }

    fn add(&mut self, neighbour: &Sides, before: Option<&Sides>, offset: i32) -> Result<Added, Error> {
        let leave = |text: String, is_warning| {
            Ok(Added { motion: None, validity: 0.0, left_out: Some(LeftOut { text, is_warning }) })
        };
        let centre = self.centre;
        let (height, width) = centre.size();
        if neighbour.size() != centre.size() {
            let (of_height, of_width) = neighbour.size();
            return leave(format!("it has {of_width}x{of_height} pixels, the frame {width}x{height}"), true);
        }
        if neighbour.count() != centre.count() {
            return leave("it has another number of denoised pictures".into(), true);
        }
        let flicker = neighbour.flicker()?;
        let direction = usize::from(offset > 0);
        let (mut motion, mut ways, mut like, mut are_all_same) = (None, Vec::with_capacity(2), f64::INFINITY, true);
        for h in 0..2 {
            let (own, other) = (centre.half(h)?, neighbour.half(h)?);
            are_all_same &= are_same(&own.denoised, &other.denoised);
            if are_all_same && h == 1 {
                return leave("its denoised halves are this frame's own and add nothing".into(), false);
            }
            // The last step is that from the frame before to the neighbour.
            let of_before;
            let from = match (offset.abs(), before) {
                (1, _) => &own,
                (_, Some(before)) => {
                    of_before = before.half(h)?;
                    &of_before
                }
                (_, None) => return leave("the frame between is missing".into(), false),
            };
            let (step, said) = step(from, &other, self.settings.motion[direction]);
            motion = motion.or(Some(said));
            let field = match &self.ways[direction] {
                Some(ways) if offset.abs() > 1 => composed(&ways[h], &step),
                None if offset.abs() > 1 => return leave("the frame between is missing".into(), false),
                _ => step,
            };
            like = like.min(likeness(&own.denoised, &other.denoised, &field));
            let mut valid = validity(&own.guides(), &other.guides(), &field);
            keep_same(&own.brightness(), &other.brightness(), &flicker, &field, &mut valid);
            ways.push(Way { valid, field });
        }
        let [a, b] = [&ways[0], &ways[1]];
        let share = 0.5 * (mean(&a.valid) + mean(&b.valid));
        let shared = self.shared_noise(neighbour, [a, b])?;
        let left_out = if share < LEAST_VALIDITY || like < LEAST_LIKENESS {
            Some((format!("it shows something else (mean validity {share:.2}, correlation of z {like:.2})"), false))
        } else if let Some(shared) = shared.filter(|shared| *shared > MOST_SHARED_NOISE) {
            let halves = "noise of one of its halves is correlated with this frame's other half";
            Some((format!("{halves} by {shared:.2}: render every frame and half with a seed of its own"), true))
        } else {
            None
        };
        if left_out.is_none() {
            let empty = || [0; 3].map(|_| TemporalMean::new(centre.count(), height, width));
            let sums = self.sums.get_or_insert_with(empty);
            for (h, way) in ways.iter().enumerate() {
                sums[h].add(&borrowed(&neighbour.pictures(h)?), &way.field, &way.valid);
            }
            let field = of_full([&a.field, &b.field], [&a.valid, &b.valid]);
            let valid = Image::mean_of(&a.valid, &b.valid);
            sums[2].add(&borrowed(&neighbour.full()?), &field, &valid);
        }
        if offset.unsigned_abs() < self.settings.extra_frames as u32 {
            let mut fields = ways.into_iter().map(|way| way.field);
            self.ways[direction] = fields.next().zip(fields.next()).map(|(a, b)| [a, b]);
        }
        let left_out = left_out.map(|(text, is_warning)| LeftOut { text, is_warning });
        Ok(Added { motion, validity: share, left_out })
    }

    /// The larger excess of both orders of halves.
    fn shared_noise(&self, neighbour: &Sides, ways: [&Way; 2]) -> Result<Option<f64>, Error> {
        let centre = self.centre;
        let (height, width) = centre.size();
        let rows = height.min(ROWS_LOOKED_AT);
        let top = (height - rows) / 2;
        let [a, b] = [centre.noisy_rows(0, top..top + rows)?, centre.noisy_rows(1, top..top + rows)?];
        let mut most: Option<f64> = None;
        for (h, own, other_half) in [(0, &b, &a), (1, &a, &b)] {
            // What the neighbour's half gives to this half is compared with the other half's noise.
            let theirs = neighbour.noisy_rows(h, top..top + rows)?;
            let field = ways[h].field.crop(top, 0, rows, width);
            let found = shared_noise(pair(own), pair(other_half), pair(&theirs), &field);
            most = [most, found].into_iter().flatten().reduce(f64::max);
        }
        Ok(most)
    }

    fn finish(self) -> Result<Option<Vec<DenoisedVariant>>, Error> {
        let Some([a, b, full]) = self.sums else { return Ok(None) };
        let a = a.finish(&borrowed(&self.centre.pictures(0)?));
        let b = b.finish(&borrowed(&self.centre.pictures(1)?));
        let full = full.finish(&borrowed(&self.centre.full()?));
        let means = a.into_iter().zip(b).zip(full);
        Ok(Some(means.map(|((a, b), full)| DenoisedVariant { halves: [a, b], full: Some(full) }).collect()))
    }
}

fn pair(images: &[Image; 2]) -> Noisy<'_> {
    Noisy { radiance: &images[0], denoised: &images[1] }
}

fn borrowed<'a>(pictures: &'a [Cow<Image>]) -> Vec<&'a Image> {
    pictures.iter().map(|picture| &**picture).collect()
}

fn mean(image: &Image) -> f64 {
    image.data().iter().map(|v| f64::from(*v)).sum::<f64>() / image.data().len().max(1) as f64
}

/// From one half's pictures to those of the next frame in a direction, and in words by what.
fn step(from: &Side, to: &Side, reading: Option<Convention>) -> (Field, String) {
    let pass = from
        .motion
        .as_deref()
        .zip(reading)
        .filter(|(motion, reading)| !says_nothing(motion) && holds(reading, motion, &alignment(from, to)));
    match pass {
        Some((motion, reading)) => (reading.field(motion), reading.to_string()),
        None => {
            let estimate = estimated(&from.matchable(), &to.matchable());
            match by_position(from, to, &estimate) {
                Some(Ok(field)) => (field, "position".to_string()),
                Some(Err(why)) => (estimate, format!("estimated (position: {why})")),
                None => (estimate, "estimated".to_string()),
            }
        }
    }
}

/// Motion by world positions and cameras, as estimated where positions are not known; why not, where positions are there.
fn by_position(from: &Side, to: &Side, estimate: &Field) -> Option<Result<Field, String>> {
    let field = match (from.seen.as_deref()?, to.seen.as_deref()) {
        (Ok(own), Some(Ok(other))) => moved(&own.position, &own.camera, &other.camera, estimate),
        (Err(why), _) => return Some(Err(why.to_string())),
        (_, Some(Err(why))) => return Some(Err(format!("in the neighbour {why}"))),
        (_, None) => return Some(Err("the neighbour has none".to_string())),
    };
    // Positions know nothing of what moves itself.
    let is_as_good = alignment(from, to).is_as_good(&field, estimate);
    Some(is_as_good.then_some(field).ok_or_else(|| "it lays features over each other less well".to_string()))
}

/// What two frames' motion is judged by.
fn alignment<'a>(from: &'a Side, to: &'a Side) -> Alignment<'a> {
    let features = Alignment::of(&from.guides(), &to.guides());
    if features.is_empty() { Alignment::of_pictures(&from.denoised, &to.denoised) } else { features }
}

/// Looks at a frame's pass and the neighbour at `offset`, one before or after it.
pub fn look_for_motion(centre: &Decoded, neighbour: &Decoded, offset: i32, search: &mut MotionSearch) {
    let Some(motion) = &centre.motion else { return };
    let sizes = [&centre.frame, &neighbour.frame].map(|frame| (frame.height(), frame.width()));
    if sizes[0] != sizes[1] {
        return;
    }
    for (h, motion) in motion.iter().enumerate() {
        let (own, other) = (centre.half(h), neighbour.half(h));
        let features = Alignment::of(
            &Guides { albedo: own.albedo.as_ref(), normal: own.normal.as_ref() },
            &Guides { albedo: other.albedo.as_ref(), normal: other.normal.as_ref() },
        );
        let alignment =
            if features.is_empty() { Alignment::of_pictures(&own.denoised, &other.denoised) } else { features };
        search.look(motion, offset, &alignment);
    }
}
