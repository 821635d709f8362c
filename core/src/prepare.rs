//! From a frame as read to what the method computes on: one exposure for both halves, clamped
//! colours, missing pixels marked, feature tensors in channel order.

use crate::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, NORMAL, RADIANCE, VISIBILITY};
use crate::frame::{Frame, HalfBuffer};
use crate::image::Image;
use crate::plan::Plan;

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

/// Unusual pixels and features.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Findings {
    /// Features that are there, but at no pixel finite in both halves: they count as absent.
    pub unusable: FeatureSet,
    /// Pixels with NaN or Inf in any role but the unusable features.
    pub missing_pixels: usize,
    /// Negative colour values, clamped at 0.
    pub negative_values: usize,
}

/// Whether radiance is brought to the method's scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Exposure {
    /// As in the paper: values as they are.
    AsIs,
    /// One factor for both halves, from finite pixels of the denoised images only.
    Normalised,
}

/// Mean of the darker 95 % of the positive z̄ that normalised exposure aims at: the constants of the method
/// (0.01, log(1 + d)) are made for renders of about this brightness.
const TARGET_MEAN: f64 = 0.25;
/// Share of the pixels that count for exposure: emitters seen directly do not.
const EXPOSED_SHARE: f64 = 0.95;

/// What is decided once for a whole frame, however it is cut afterwards.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Survey {
    /// As [`Prepared::exposure`].
    pub exposure: f32,
    /// As [`Prepared::set`].
    pub set: FeatureSet,
    /// As [`Prepared::found`].
    pub found: Findings,
}

impl Survey {
    /// Looks a frame over.
    pub fn of(frame: &Frame, exposure: Exposure) -> Self {
        let unusable = unusable_features(frame);
        let valid = validity(frame, unusable);
        let exposure = match exposure {
            Exposure::AsIs => 1.0,
            Exposure::Normalised => normalised_exposure(frame, &valid),
        };
        let set = FeatureSet {
            albedo: !unusable.albedo && varies(frame, &valid, |h| h.albedo.as_ref()),
            normal: !unusable.normal && varies(frame, &valid, |h| h.normal.as_ref()),
            visibility: !unusable.visibility && varies(frame, &valid, |h| h.visibility.as_ref()),
        };
        let found = Findings {
            unusable,
            missing_pixels: valid.plane(0).iter().filter(|v| **v == 0.0).count(),
            negative_values: colours(frame).map(|image| negative_values(image, &valid)).sum(),
        };
        Self { exposure, set, found }
    }

    /// The same with only those features that a model was `fitted` with: weights of others were
    /// never trained.
    pub fn with_features_of(self, fitted: FeatureSet) -> Self {
        let FeatureSet { albedo, normal, visibility } = self.set;
        let set = FeatureSet {
            albedo: albedo && fitted.albedo,
            normal: normal && fitted.normal,
            visibility: visibility && fitted.visibility,
        };
        Self { set, ..self }
    }
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
        let mut denoised = Image::zeros(3, frame.height(), frame.width());
        for c in 0..3 {
            fill_colour(full.plane(c), valid.plane(0), factor, denoised.plane_mut(c));
        }
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

/// Features of which no pixel is finite in both halves. Were they taken for what they claim to be,
/// every pixel would be missing.
pub fn unusable_features(frame: &Frame) -> FeatureSet {
    let unusable = |feature: fn(&HalfBuffer) -> Option<&Image>| {
        let images: Vec<&Image> = [&frame.a, &frame.b].into_iter().filter_map(feature).collect();
        let finite = |i: usize| images.iter().all(|f| (0..f.channels()).all(|c| f.plane(c)[i].is_finite()));
        !images.is_empty() && !(0..images[0].pixels()).any(finite)
    };
    FeatureSet {
        albedo: unusable(|h| h.albedo.as_ref()),
        normal: unusable(|h| h.normal.as_ref()),
        visibility: unusable(|h| h.visibility.as_ref()),
    }
}

/// The images of a half that decide which pixels are missing.
fn images(h: &HalfBuffer, unusable: FeatureSet) -> impl Iterator<Item = &Image> {
    [
        Some(&h.radiance),
        Some(&h.denoised),
        h.albedo.as_ref().filter(|_| !unusable.albedo),
        h.normal.as_ref().filter(|_| !unusable.normal),
        h.visibility.as_ref().filter(|_| !unusable.visibility),
    ]
    .into_iter()
    .flatten()
}

/// The images whose negative values are clamped.
fn colours(frame: &Frame) -> impl Iterator<Item = &Image> {
    [&frame.a, &frame.b].into_iter().flat_map(|h| [&h.radiance, &h.denoised]).chain(&frame.denoised)
}

fn negative_values(image: &Image, valid: &Image) -> usize {
    let values = image.data().iter().zip(valid.plane(0).iter().cycle());
    values.filter(|(v, ok)| **v < 0.0 && **ok != 0.0).count()
}

fn validity(frame: &Frame, unusable: FeatureSet) -> Image {
    let mut valid = Image::filled(1, frame.height(), frame.width(), 1.0);
    for image in images(&frame.a, unusable).chain(images(&frame.b, unusable)).chain(&frame.denoised) {
        for c in 0..image.channels() {
            for (v, x) in valid.plane_mut(0).iter_mut().zip(image.plane(c)) {
                if !x.is_finite() {
                    *v = 0.0;
                }
            }
        }
    }
    valid
}

fn normalised_exposure(frame: &Frame, valid: &Image) -> f32 {
    let (a, b) = (&frame.a.denoised, &frame.b.denoised);
    let mut means: Vec<f64> = (0..a.pixels())
        .filter(|&i| valid.plane(0)[i] != 0.0)
        .map(|i| {
            (0..3).map(|c| f64::from(a.plane(c)[i].max(0.0)) + f64::from(b.plane(c)[i].max(0.0))).sum::<f64>() / 6.0
        })
        .filter(|&m| m > 0.0)
        .collect();
    means.sort_by(f64::total_cmp);
    means.truncate(((means.len() as f64 * EXPOSED_SHARE).ceil() as usize).max(1).min(means.len()));
    let mean = means.iter().sum::<f64>() / means.len().max(1) as f64;
    // Beyond this range the squares of exposures and radiances leave f32.
    let factor = (TARGET_MEAN / mean).clamp(1e-12, 1e12);
    if factor.is_finite() && !means.is_empty() { factor as f32 } else { 1.0 }
}

fn varies<'a>(frame: &'a Frame, valid: &Image, feature: impl Fn(&'a HalfBuffer) -> Option<&'a Image>) -> bool {
    let (Some(a), Some(b)) = (feature(&frame.a), feature(&frame.b)) else { return false };
    (0..a.channels()).any(|c| {
        let mut values =
            (0..a.pixels()).filter(|&i| valid.plane(0)[i] != 0.0).flat_map(|i| [a.plane(c)[i], b.plane(c)[i]]);
        values.next().is_some_and(|first| values.any(|v| v != first))
    })
}

fn half_features(half: &HalfBuffer, set: FeatureSet, exposure: f32, valid: &Image) -> Image {
    let mut features = Image::zeros(FEATURE_CHANNELS, valid.height(), valid.width());
    for k in 0..3 {
        fill_colour(half.radiance.plane(k), valid.plane(0), exposure, features.plane_mut(RADIANCE + k));
        fill_colour(half.denoised.plane(k), valid.plane(0), exposure, features.plane_mut(DENOISED + k));
    }
    let optional = [
        (ALBEDO, set.albedo, &half.albedo),
        (VISIBILITY, set.visibility, &half.visibility),
        (NORMAL, set.normal, &half.normal),
    ];
    for (first, used, image) in optional {
        if let (true, Some(image)) = (used, image) {
            for c in 0..image.channels() {
                let target = features.plane_mut(first + c).iter_mut();
                for ((t, v), ok) in target.zip(image.plane(c)).zip(valid.plane(0)) {
                    // Far outside their ranges, so that their squared differences stay finite.
                    *t = if *ok != 0.0 { v.clamp(-1e4, 1e4) } else { 0.0 };
                }
            }
        }
    }
    features
}

/// Scales and clamps one colour plane.
fn fill_colour(source: &[f32], valid: &[f32], exposure: f32, out: &mut [f32]) {
    for ((out, v), ok) in out.iter_mut().zip(source).zip(valid) {
        if *ok != 0.0 {
            // Radiance near the end of f32 must not overflow when squared and summed.
            *out = (v * exposure).clamp(0.0, 1e15);
        }
    }
}
