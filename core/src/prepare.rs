//! From a frame as read to what the method computes on: one exposure for both halves, clamped
//! colours, missing pixels marked, feature tensors in channel order.

use crate::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, NORMAL, RADIANCE, VISIBILITY};
use crate::frame::{Frame, HalfBuffer};
use crate::image::Image;
use crate::plan::Plan;
use crate::survey::validity;

pub use crate::survey::{Exposure, Findings, Survey};

/// A frame in the method's units.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Radiance in the file's units times this is radiance in the method's units.
    pub exposure: f32,
    /// Features of half a and of half b, `[13, H, W]`; zero at missing pixels.
    pub halves: [Image; 2],
    /// z of the full buffer, `[3, H, W]`, clamped at 0, zero at missing pixels.
    pub denoised: Image,
    /// 1 where a pixel counts, 0 where it is missing, `[1, H, W]`; None when none is missing.
    pub valid: Option<Image>,
    /// Features that are there and not constant.
    pub set: FeatureSet,
    /// What of the picture is computed.
    pub plan: Plan,
    /// What was found on the way.
    pub found: Findings,
}

/// Whose z, albedo, normal and visibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Buffer {
    /// The half's own.
    Half,
    /// Of all samples.
    Full,
}

impl Prepared {
    /// Brings a frame into the method's units.
    pub fn new(frame: &Frame, exposure: Exposure) -> Self {
        Self::by_survey(frame, Survey::of(frame, exposure))
    }

    /// Brings a frame, or a band of it, into the units that were decided for the whole frame.
    pub fn by_survey(frame: &Frame, survey: Survey) -> Self {
        let Survey { exposure: factor, set, found } = survey;
        let valid = validity(frame, found.unusable);
        let half = |h: &HalfBuffer| half_features(h, set, factor, &valid);
        let halves = [half(&frame.a), half(&frame.b)];
        let mean;
        let full = match &frame.denoised {
            Some(full) => full,
            None => {
                mean = Image::mean_of(&frame.a.denoised, &frame.b.denoised);
                &mean
            }
        };
        let denoised = Image::from_rows(3, frame.height(), frame.width(), |c, y, row| {
            fill_colour(full.row(c, y), valid.row(0, y), factor, row);
        });
        let valid = valid.plane(0).contains(&0.0).then_some(valid);
        let plan = Plan::new(&halves, valid.as_ref());
        Self { plan, exposure: factor, halves, denoised, valid, set, found }
    }

    pub fn height(&self) -> usize {
        self.denoised.height()
    }

    pub fn width(&self) -> usize {
        self.denoised.width()
    }

    /// Row `y` of feature `c` of half `h`, with z and the other features of the buffer asked for; y is
    /// always the half's. The full buffer's are what g_c is evaluated on when the picture is made.
    pub fn feature_row(&self, h: usize, buffer: Buffer, c: usize, y: usize, row: &mut [f32]) {
        let own = self.halves[h].row(c, y);
        match (buffer, c) {
            (Buffer::Full, ALBEDO..DENOISED) => {
                let other = self.halves[1 - h].row(c, y);
                row.iter_mut().zip(own.iter().zip(other)).for_each(|(v, (a, b))| *v = 0.5 * (a + b));
            }
            (Buffer::Full, DENOISED..) => row.copy_from_slice(self.denoised.row(c - DENOISED, y)),
            _ => row.copy_from_slice(own),
        }
    }

    /// Whether pixel `i` (y * width + x) counts.
    pub fn is_valid(&self, i: usize) -> bool {
        self.valid.as_ref().is_none_or(|v| v.plane(0)[i] != 0.0)
    }
}

fn half_features(half: &HalfBuffer, set: FeatureSet, exposure: f32, valid: &Image) -> Image {
    let albedo = half.albedo.as_ref().filter(|_| set.albedo);
    let visibility = half.visibility.as_ref().filter(|_| set.visibility);
    let normal = half.normal.as_ref().filter(|_| set.normal);
    Image::from_rows(FEATURE_CHANNELS, valid.height(), valid.width(), |c, y, row| {
        let valid = valid.row(0, y);
        match c {
            RADIANCE..ALBEDO => fill_colour(half.radiance.row(c - RADIANCE, y), valid, exposure, row),
            DENOISED.. => fill_colour(half.denoised.row(c - DENOISED, y), valid, exposure, row),
            ALBEDO..VISIBILITY => fill_feature(albedo.map(|f| f.row(c - ALBEDO, y)), valid, row),
            VISIBILITY => fill_feature(visibility.map(|f| f.row(0, y)), valid, row),
            _ => fill_feature(normal.map(|f| f.row(c - NORMAL, y)), valid, row),
        }
    })
}

/// Copies a row of a feature; one that is not in use stays zero.
fn fill_feature(source: Option<&[f32]>, valid: &[f32], out: &mut [f32]) {
    for ((out, v), ok) in out.iter_mut().zip(source.unwrap_or_default()).zip(valid) {
        // Far outside their ranges, so that their squared differences stay finite.
        *out = if *ok != 0.0 { v.clamp(-1e4, 1e4) } else { 0.0 };
    }
}

/// Scales and clamps a row of a colour.
fn fill_colour(source: &[f32], valid: &[f32], exposure: f32, out: &mut [f32]) {
    for ((out, v), ok) in out.iter_mut().zip(source).zip(valid) {
        // Radiance near the end of f32 must not overflow when squared and summed.
        *out = if *ok != 0.0 { (v * exposure).clamp(0.0, 1e15) } else { 0.0 };
    }
}
