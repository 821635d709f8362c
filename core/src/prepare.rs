//! From a frame as read to what the method computes on: one exposure for both halves, clamped
//! colours, missing pixels marked, feature tensors in channel order.

use crate::differences::Differences;
use crate::plan::Plan;
use sspc_image::{DenoisedVariant, Frame, HalfBuffer, HalfWeights, Image, Role};
use sspc_kernels::features::{ALBEDO, DENOISED, FEATURE_CHANNELS, FeatureSet, NORMAL, RADIANCE, VISIBILITY};
use sspc_kernels::region::Region;
use sspc_kernels::windows::Windows;
use std::borrow::Cow;
use std::ops::Range;
use std::sync::Arc;

pub use crate::frame_stats::{Exposure, Findings, FrameStats};
use crate::frame_stats::{presence, validity};
use crate::trust::Trust;

/// A frame in the method's units.
#[derive(Clone, Debug)]
pub struct Prepared {
    /// Radiance in the file's units times this is radiance in the method's units.
    pub exposure: f32,
    /// Features of half a and of half b, `[13, H, W]`; zero at missing pixels. Shared with the
    /// objective that is trained on.
    pub halves: [Arc<Image>; 2],
    /// z of the full buffer, `[3, H, W]`, clamped at 0, zero at missing pixels.
    pub denoised: Image,
    /// 1 where a pixel counts, 0 where it is missing, `[1, H, W]`; None when none is missing.
    pub valid: Option<Image>,
    /// Features that are there and not constant.
    pub set: FeatureSet,
    /// What is fitted in the place of z, one network for each, in the order of the model; none where that is z alone.
    pub variants: Vec<Arc<Variant>>,
    /// What the corrected picture is mixed with as far as the halves say (METHOD (14d)).
    pub composite: Option<Arc<Variant>>,
    /// What each half weighs in means of both.
    pub weights: HalfWeights,
    /// Differences of y that the renderer estimated, to train on and to judge by.
    pub differences: Option<Arc<Differences>>,
    /// What of the picture is computed.
    pub plan: Plan,
    /// What was found on the way.
    pub found: Findings,
}

/// Radiance near the end of f32 must not overflow when squared and summed.
const LARGEST: f32 = 1e15;
/// Noisy radiance counts as no less, in the method's units: lobes beside a firefly reach so far, what lies below is no light.
pub const LEAST_RADIANCE: f32 = -10.0;

/// Another z in the method's units: of half a, of half b and of the full buffer, `[3, H, W]` each, clamped at 0, zero at
/// missing pixels, and z itself where it has no finite value of its own.
#[derive(Clone, Debug)]
pub struct Variant {
    /// Of half a and of half b.
    pub halves: [Image; 2],
    /// Of the full buffer.
    pub denoised: Image,
}

impl Variant {
    /// A variant in the method's units; `ground` is the z of half a, of half b and of the full buffer.
    fn new(variant: &DenoisedVariant, ground: [&Image; 3], weights: HalfWeights, exposure: f32, valid: &Image) -> Self {
        let mean = || weights.mean_of(&variant.halves[0], &variant.halves[1]);
        let full = variant.full.as_ref().map_or_else(|| Cow::Owned(mean()), Cow::Borrowed);
        let of = |picture: &Image, ground: &Image| {
            Image::from_rows(3, picture.height(), picture.width(), |c, y, row| {
                let own = |x: usize| (0..3).all(|c| picture.at(c, y, x).is_finite());
                let pixels = picture.row(c, y).iter().zip(ground.row(c, y)).enumerate();
                let source: Vec<f32> = pixels.map(|(x, (v, z))| if own(x) { *v } else { *z }).collect();
                fill_denoised(&source, valid.row(0, y), exposure, row);
            })
        };
        let [a, b] = [0, 1].map(|h| of(&variant.halves[h], ground[h]));
        Self { halves: [a, b], denoised: of(&full, ground[2]) }
    }

    fn map(&self, change: impl Fn(&Image) -> Image) -> Self {
        Self { halves: self.halves.each_ref().map(&change), denoised: change(&self.denoised) }
    }
}

/// Whose z, albedo, normal and visibility.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Guides {
    /// The half's own.
    Half,
    /// Of all samples.
    Full,
}

impl Prepared {
    /// Brings a frame, or a band of it, into the units that were decided for the whole frame.
    pub fn by_stats(frame: &Frame, stats: &FrameStats) -> Self {
        let valid = validity(frame);
        let present = Role::FEATURES.map(|feature| presence(frame, feature));
        let half = |h: &HalfBuffer| half_features(h, stats, &valid, &present);
        let halves = [half(&frame.a), half(&frame.b)];
        let denoised = colour(&baseline(frame), stats.exposure, &valid);
        let ground = [&frame.a.denoised, &frame.b.denoised, &*baseline(frame)];
        let of = |variant| Arc::new(Variant::new(variant, ground, frame.weights, stats.exposure, &valid));
        let (variants, composite) = (frame.variants.iter().map(of).collect(), frame.composite.as_ref().map(of));
        Self { variants, composite, weights: frame.weights, ..Self::of_parts(halves, denoised, valid, stats) }
    }

    /// The same of a whole frame that is given away, each half as soon as its features are there; and
    /// the [`baseline`], which the correction will be added to.
    pub fn of_owned(frame: Frame, stats: &FrameStats) -> (Self, Image) {
        let valid = validity(&frame);
        let present = Role::FEATURES.map(|feature| presence(&frame, feature));
        let Frame { a, b, denoised, variants, composite, weights, .. } = frame;
        let baseline = denoised.unwrap_or_else(|| weights.mean_of(&a.denoised, &b.denoised));
        let ground = [&a.denoised, &b.denoised, &baseline];
        let of = |variant| Arc::new(Variant::new(&variant, ground, weights, stats.exposure, &valid));
        let (variants, composite) = (variants.into_iter().map(of).collect(), composite.map(of));
        let features = |half: HalfBuffer| half_features(&half, stats, &valid, &present);
        let halves = [features(a), features(b)];
        let denoised = colour(&baseline, stats.exposure, &valid);
        (Self { variants, composite, weights, ..Self::of_parts(halves, denoised, valid, stats) }, baseline)
    }

    fn of_parts(halves: [Image; 2], denoised: Image, valid: Image, stats: &FrameStats) -> Self {
        let FrameStats { exposure, set, found, .. } = *stats;
        let valid = valid.plane(0).contains(&0.0).then_some(valid);
        let plan = match stats.trust() {
            Trust::None(_) => Plan::nothing(halves[0].height(), halves[0].width()),
            Trust::Independent => Plan::new(&halves, valid.as_ref()),
        };
        let (halves, weights) = (halves.map(Arc::new), HalfWeights::EQUAL);
        let (variants, composite, differences) = (Vec::new(), None, None);
        Self { plan, exposure, halves, denoised, valid, set, variants, composite, weights, differences, found }
    }

    /// How many networks are fitted.
    pub fn networks(&self) -> usize {
        self.variants.len().max(1)
    }

    /// The frame as network `k` and its g_c see it: variant `k` in the place of z, and nothing beside it.
    ///
    /// # Panics
    /// When there is no such variant.
    pub fn of_variant(&self, k: usize) -> Cow<'_, Self> {
        if self.variants.is_empty() {
            assert_eq!(k, 0, "a frame without variants has one z");
            return Cow::Borrowed(self);
        }
        let Variant { halves, denoised } = &*self.variants[k];
        let with_z = |h: usize| {
            let own = &self.halves[h];
            Arc::new(Image::from_rows(FEATURE_CHANNELS, own.height(), own.width(), |c, y, row| {
                row.copy_from_slice(if c >= DENOISED { halves[h].row(c - DENOISED, y) } else { own.row(c, y) });
            }))
        };
        Cow::Owned(Self {
            halves: [with_z(0), with_z(1)],
            denoised: denoised.clone(),
            valid: self.valid.clone(),
            variants: Vec::new(),
            composite: None,
            plan: self.plan.clone(),
            differences: self.differences.clone(),
            ..*self
        })
    }

    /// With every pixel to be computed, unless the `whole` frame's halves are equal everywhere: there
    /// is nothing to correct then. A picture that is not judged is computed so, as in the paper.
    pub fn without_skips(mut self, whole: &FrameStats) -> Self {
        if whole.noisy {
            self.plan = Plan::everything(self.height(), self.width());
        }
        self
    }

    /// Some rows by themselves, which begin at a multiple of [`crate::plan::BLOCK_ROWS`].
    pub fn rows(&self, rows: Range<usize>) -> Self {
        let cut = |image: &Image| image.crop(rows.start, 0, rows.len(), image.width());
        Self {
            halves: self.halves.each_ref().map(|half| Arc::new(cut(half))),
            denoised: cut(&self.denoised),
            valid: self.valid.as_ref().map(cut),
            variants: self.variants.iter().map(|variant| Arc::new(variant.map(cut))).collect(),
            composite: self.composite.as_ref().map(|composite| Arc::new(composite.map(cut))),
            plan: self.plan.of_rows(rows.clone()),
            differences: None,
            ..*self
        }
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.denoised.height()
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.denoised.width()
    }

    /// Some columns of row `y` of feature `c` of half `h`, with z and the other features of the guides asked for; y is always
    /// the half's. The full buffer's are what g_c is evaluated on when the picture is made.
    pub fn features(&self, h: usize, guides: Guides, c: usize, y: usize, columns: Range<usize>, out: &mut [f32]) {
        let [own, other] = [h, 1 - h].map(|h| &self.halves[h].row(c, y)[columns.clone()]);
        match (guides, c) {
            (Guides::Full, ALBEDO..DENOISED) => {
                let [of_own, of_other] = [h, 1 - h].map(|h| self.weights.of(h));
                out.iter_mut().zip(own.iter().zip(other)).for_each(|(v, (a, b))| *v = of_own * a + of_other * b);
            }
            (Guides::Full, DENOISED..) => out.copy_from_slice(&self.denoised.row(c - DENOISED, y)[columns]),
            _ => out.copy_from_slice(own),
        }
    }

    /// The windows of g_c of some pixels of half `h`, padded by `radius`, of the same features. Guides of the full buffer come
    /// without y: they are used with the radiance of either half.
    pub fn windows(&self, h: usize, guides: Guides, region: Region, radius: usize) -> Windows {
        let valid = self.valid.as_ref();
        let fill = |c: usize, y: usize, columns: Range<usize>, out: &mut [f32]| match (valid, guides, c) {
            (Some(valid), _, FEATURE_CHANNELS) => out.copy_from_slice(&valid.row(0, y)[columns]),
            (_, Guides::Full, RADIANCE..ALBEDO) => {}
            _ => self.features(h, guides, c, y, columns, out),
        };
        let size = (self.height(), self.width());
        Windows::of_region(size, region, fill, valid.is_some(), self.set, radius, Vec::new())
    }

    /// Row `y` of channel `k` of what the correction of half `h` is compared with: y of the other half.
    pub fn target_row(&self, h: usize, k: usize, y: usize) -> &[f32] {
        self.halves[1 - h].row(RADIANCE + k, y)
    }

    /// The same of pixel `i` (y * width + x).
    pub fn target(&self, h: usize, k: usize, i: usize) -> f32 {
        self.halves[1 - h].plane(RADIANCE + k)[i]
    }

    /// Whether pixel `i` (y * width + x) counts.
    pub fn is_valid(&self, i: usize) -> bool {
        self.valid.as_ref().is_none_or(|v| v.plane(0)[i] != 0.0)
    }
}

/// The picture in the frame's units that a correction is compared with and added to: the full buffer's
/// z, else the mean of both halves' by their weights.
pub fn baseline(frame: &Frame) -> Cow<'_, Image> {
    match &frame.denoised {
        Some(full) => Cow::Borrowed(full),
        None => Cow::Owned(frame.weights.mean_of(&frame.a.denoised, &frame.b.denoised)),
    }
}

/// A picture in the method's units.
fn colour(picture: &Image, exposure: f32, valid: &Image) -> Image {
    Image::from_rows(3, picture.height(), picture.width(), |c, y, row| {
        fill_denoised(picture.row(c, y), valid.row(0, y), exposure, row);
    })
}

/// `present` says where albedo, normal and visibility are there; elsewhere they are zero, in both halves.
fn half_features(
    half: &HalfBuffer,
    &FrameStats { exposure, set, .. }: &FrameStats,
    valid: &Image,
    present: &[Option<Image>; 3],
) -> Image {
    let albedo = half.albedo.as_ref().filter(|_| set.albedo);
    let visibility = half.visibility.as_ref().filter(|_| set.visibility);
    let normal = half.normal.as_ref().filter(|_| set.normal);
    Image::from_rows(FEATURE_CHANNELS, valid.height(), valid.width(), |c, y, row| {
        let valid = valid.row(0, y);
        let of = |feature: usize| present[feature].as_ref().map(|image| image.row(0, y));
        match c {
            RADIANCE..ALBEDO => fill_radiance(half.radiance.row(c - RADIANCE, y), valid, exposure, row),
            DENOISED.. => fill_denoised(half.denoised.row(c - DENOISED, y), valid, exposure, row),
            ALBEDO..VISIBILITY => fill_feature(albedo.map(|f| f.row(c - ALBEDO, y)), valid, of(0), row),
            VISIBILITY => fill_feature(visibility.map(|f| f.row(0, y)), valid, of(2), row),
            _ => fill_feature(normal.map(|f| f.row(c - NORMAL, y)), valid, of(1), row),
        }
    })
}

/// Copies a row of a feature; one that is not in use stays zero.
fn fill_feature(source: Option<&[f32]>, valid: &[f32], present: Option<&[f32]>, out: &mut [f32]) {
    for ((out, v), ok) in out.iter_mut().zip(source.unwrap_or_default()).zip(valid) {
        // Far outside their ranges, so that their squared differences stay finite.
        *out = if *ok != 0.0 { v.clamp(-1e4, 1e4) } else { 0.0 };
    }
    for (out, present) in out.iter_mut().zip(present.unwrap_or_default()) {
        *out = if *present != 0.0 { *out } else { 0.0 };
    }
}

/// Scales a row of a denoised picture; it knows no negative light.
fn fill_denoised(source: &[f32], valid: &[f32], exposure: f32, out: &mut [f32]) {
    fill_colour(source, valid, exposure, 0.0, out);
}

/// Scales a row of noisy radiance. Filters with negative lobes make it negative where it is dark by chance, and cut off at 0 it
/// would be too bright in the mean.
fn fill_radiance(source: &[f32], valid: &[f32], exposure: f32, out: &mut [f32]) {
    fill_colour(source, valid, exposure, LEAST_RADIANCE, out);
}

fn fill_colour(source: &[f32], valid: &[f32], exposure: f32, least: f32, out: &mut [f32]) {
    for ((out, v), ok) in out.iter_mut().zip(source).zip(valid) {
        *out = if *ok != 0.0 { (v * exposure).clamp(least, LARGEST) } else { 0.0 };
    }
}
