//! What one frame consists of, as read: values in the file's own units, NaN and Inf included.

use crate::{Buffer, HalfWeights, Image, Role};
use std::path::PathBuf;

/// Which channels of which file filled a role.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RoleSource {
    /// What the channels mean.
    pub role: Role,
    /// Which samples they were made from.
    pub buffer: Buffer,
    /// 0 for what every frame has, from 1 on for further denoised pictures ([`Frame::variants`]).
    pub variant: usize,
    /// The file.
    pub path: PathBuf,
    /// Full channel names as in the file, in component order.
    pub channels: Vec<String>,
}

/// One half of the samples: everything rendered or denoised from it alone.
#[derive(Clone, Debug)]
pub struct HalfBuffer {
    /// y: linear scene-referred RGB, `[3, H, W]`.
    pub radiance: Image,
    /// z: the denoiser's output on this half, `[3, H, W]`.
    pub denoised: Image,
    /// ρ: `[3, H, W]`, 0..1.
    pub albedo: Option<Image>,
    /// n: `[3, H, W]`, -1..1.
    pub normal: Option<Image>,
    /// v: `[1, H, W]`, 0..1.
    pub visibility: Option<Image>,
}

/// Another picture to correct from: what a further denoiser, or the same with other settings, made of the same samples.
#[derive(Clone, Debug)]
pub struct DenoisedVariant {
    /// z of half a and of half b, `[3, H, W]`.
    pub halves: [Image; 2],
    /// z of the full buffer, `[3, H, W]`; without it, the mean of both halves' by their weights.
    pub full: Option<Image>,
}

/// A rendered reference; with halves of its own, its noise can be removed from relL2.
#[derive(Clone, Debug)]
pub struct Reference {
    /// Radiance, `[3, H, W]`.
    pub mean: Image,
    /// Two independent halves of which `mean` is the mean.
    pub halves: Option<[Image; 2]>,
}

/// A frame: two half buffers of one size, and the denoised full buffer.
#[derive(Clone, Debug)]
pub struct Frame {
    /// One half of the samples.
    pub a: HalfBuffer,
    /// The other half.
    pub b: HalfBuffer,
    /// The denoiser's output on the full buffer; without it, the mean of both denoised halves by their weights is the
    /// baseline.
    pub denoised: Option<Image>,
    /// What is fitted in the place of z, one network for each, in the order of the model; none where that is z alone.
    pub variants: Vec<DenoisedVariant>,
    /// A denoised picture that was put together from those of the frame's additive passes; no network starts from it.
    pub composite: Option<DenoisedVariant>,
    /// What each half weighs in means of both.
    pub weights: HalfWeights,
    /// dx and dy of half a and of half b, `[3, H, W]` each, where they are asked for and both halves have both.
    pub differences: Option<[[Image; 2]; 2]>,
}

impl DenoisedVariant {
    /// The rows `top..top + height` of every image.
    pub fn rows(&self, top: usize, height: usize) -> DenoisedVariant {
        let cut = |image: &Image| image.crop(top, 0, height, image.width());
        DenoisedVariant { halves: self.halves.each_ref().map(cut), full: self.full.as_ref().map(cut) }
    }
}

impl HalfBuffer {
    /// The image of an optional feature.
    pub fn feature(&self, role: Role) -> Option<&Image> {
        match role {
            Role::Albedo => self.albedo.as_ref(),
            Role::Normal => self.normal.as_ref(),
            Role::Visibility => self.visibility.as_ref(),
            Role::Radiance | Role::Denoised | Role::Motion | Role::Position | Role::Dx | Role::Dy => None,
        }
    }

    /// The rows `top..top + height` of every image.
    pub fn rows(&self, top: usize, height: usize) -> HalfBuffer {
        let cut = |image: &Image| image.crop(top, 0, height, image.width());
        HalfBuffer {
            radiance: cut(&self.radiance),
            denoised: cut(&self.denoised),
            albedo: self.albedo.as_ref().map(cut),
            normal: self.normal.as_ref().map(cut),
            visibility: self.visibility.as_ref().map(cut),
        }
    }
}

impl Frame {
    /// Two halves of equal samples and nothing else.
    pub fn of_halves(a: HalfBuffer, b: HalfBuffer) -> Self {
        let weights = HalfWeights::EQUAL;
        Self { a, b, denoised: None, variants: Vec::new(), composite: None, weights, differences: None }
    }

    /// Whether either half has the feature.
    pub fn has(&self, feature: Role) -> bool {
        self.a.feature(feature).is_some() || self.b.feature(feature).is_some()
    }

    /// Whether at least one pixel of the feature is finite in every half that has it.
    pub fn has_finite(&self, feature: Role) -> bool {
        let images: Vec<&Image> = [&self.a, &self.b].into_iter().filter_map(|half| half.feature(feature)).collect();
        let finite = |i: usize| images.iter().all(|f| (0..f.channels()).all(|c| f.plane(c)[i].is_finite()));
        !images.is_empty() && (0..images[0].pixels()).any(finite)
    }

    /// The rows `top..top + height` of every image.
    pub fn rows(&self, top: usize, height: usize) -> Frame {
        Frame {
            a: self.a.rows(top, height),
            b: self.b.rows(top, height),
            denoised: self.denoised.as_ref().map(|z| z.crop(top, 0, height, z.width())),
            variants: self.variants.iter().map(|variant| variant.rows(top, height)).collect(),
            composite: self.composite.as_ref().map(|composite| composite.rows(top, height)),
            weights: self.weights,
            differences: self.differences.as_ref().map(|halves| {
                let cut = |image: &Image| image.crop(top, 0, height, image.width());
                halves.each_ref().map(|half| half.each_ref().map(cut))
            }),
        }
    }

    /// The rows `top..top + height` of radiance and denoised alone.
    pub fn colours(&self, top: usize, height: usize) -> Frame {
        let cut = |image: &Image| image.crop(top, 0, height, image.width());
        let half = |h: &HalfBuffer| HalfBuffer {
            radiance: cut(&h.radiance),
            denoised: cut(&h.denoised),
            albedo: None,
            normal: None,
            visibility: None,
        };
        let denoised = self.denoised.as_ref().map(cut);
        Frame { denoised, weights: self.weights, ..Frame::of_halves(half(&self.a), half(&self.b)) }
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.a.radiance.height()
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.a.radiance.width()
    }
}
