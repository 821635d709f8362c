//! A frame whose headers are read and whose rows are decoded when they are asked for, so that memory need not grow with
//! the picture.

use crate::align::Placing;
use crate::checks::{Inspection, left_out, lossy_inputs};
use crate::error::Error;
use crate::files::FrameFiles;
use crate::names::CAMERAS;
use crate::output::OutputPlan;
use crate::overrides::RoleOverrides;
use crate::passes::{OpenPasses, PassSelection};
use crate::resolve::{Filled, Resolution, resolve};
use crate::samples::HalfSamples;
use rayon::prelude::*;
use sspc_image::{
    Buffer, CompactImage, DenoisedVariant, Frame, FrameRows, HalfBuffer, HalfWeights, Image, Role, RoleSource,
};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

/// Files whose channels are known to make a frame.
pub struct OpenFrame {
    resolution: Resolution,
    samples: HalfSamples,
    made: Made,
}

/// Denoised pictures of a frame that are not in its files.
#[derive(Clone, Debug, Default)]
pub struct Made {
    /// z of half a and of half b, `[3, H, W]`, where the files have none.
    pub halves: Option<[CompactImage; 2]>,
    /// z of the full buffer, where the files have none.
    pub full: Option<CompactImage>,
    /// Further ones, after those of the files.
    pub variants: Vec<MadeVariant>,
    /// Put together from those of additive passes: see [`Frame::composite`].
    pub composite: Option<MadeVariant>,
}

/// A further denoised picture that is not in the files.
#[derive(Clone, Debug)]
pub struct MadeVariant {
    /// z of half a and of half b, `[3, H, W]`.
    pub halves: [CompactImage; 2],
    /// z of the full buffer.
    pub full: CompactImage,
}

impl MadeVariant {
    /// Some rows of it.
    pub fn rows(&self, rows: &Range<usize>) -> DenoisedVariant {
        let of = |picture: &CompactImage| picture.rows(rows.clone());
        DenoisedVariant { halves: self.halves.each_ref().map(of), full: Some(of(&self.full)) }
    }
}

/// What a denoiser is given of a half.
pub struct NoisyHalf {
    /// Linear radiance, `[3, H, W]`.
    pub radiance: Image,
    /// Albedo, `[3, H, W]`.
    pub albedo: Option<Image>,
    /// Normal, `[3, H, W]`.
    pub normal: Option<Image>,
}

impl OpenFrame {
    /// Finds the roles by headers; of pixels only a pass of sample counts is read, where both halves have one.
    ///
    /// # Errors
    /// As [`resolve`], and denoised halves that are not there.
    pub fn open(files: &FrameFiles, overrides: &RoleOverrides) -> Result<Self, Error> {
        let mut open = Self::open_to_denoise(files, overrides)?;
        open.resolution.undenoised.take().map_or(Ok(open), Err)
    }

    /// The same, where denoised halves may be missing. [`Self::supply`] gives them before rows are asked for.
    ///
    /// # Errors
    /// As [`resolve`].
    pub fn open_to_denoise(files: &FrameFiles, overrides: &RoleOverrides) -> Result<Self, Error> {
        let mut resolution = resolve(files, overrides)?;
        let (samples, notes) = HalfSamples::of(files.samples, &resolution)?;
        resolution.warnings.extend(notes);
        Ok(Self { resolution, samples, made: Made::default() })
    }

    /// What is wrong with a frame without denoised halves.
    pub fn undenoised(&self) -> Option<&Error> {
        self.resolution.undenoised.as_ref().filter(|_| self.made.halves.is_none())
    }

    /// Whether the files have this role of the buffer.
    pub fn has(&self, role: Role, buffer: Buffer) -> bool {
        self.resolution.get(role, buffer).is_some()
    }

    /// Takes denoised pictures that were made of [`Self::noisy_rows`].
    ///
    /// # Panics
    /// When one of them has another size than the frame.
    pub fn supply(&mut self, made: Made) {
        let variants = made.variants.iter().flat_map(|variant| variant.halves.iter().chain([&variant.full]));
        let size = (self.height(), self.width());
        for picture in made.halves.iter().flatten().chain(&made.full).chain(variants) {
            assert_eq!((picture.height(), picture.width()), size, "size of a denoised picture");
        }
        self.made = made;
    }

    /// Takes a picture that was put together from denoised passes.
    pub fn set_composite(&mut self, composite: MadeVariant) {
        self.made.composite = Some(composite);
    }

    /// Some rows of what a denoiser is given, of half a and of half b.
    ///
    /// # Errors
    /// As [`Self::rows`].
    ///
    /// # Panics
    /// When the rows leave the picture.
    pub fn noisy_rows(&self, rows: Range<usize>) -> Result<[NoisyHalf; 2], Error> {
        let wanted = |filled: &Filled| matches!(filled.role, Role::Radiance | Role::Albedo | Role::Normal);
        let mut images = self.decode(rows, wanted)?;
        Ok([Buffer::A, Buffer::B].map(|buffer| {
            let mut take = |role| images.remove(&(role, buffer, 0));
            let (Some(radiance), albedo, normal) = (take(Role::Radiance), take(Role::Albedo), take(Role::Normal))
            else {
                // resolve() has refused frames without colour.
                unreachable!("a resolved frame has both halves");
            };
            NoisyHalf { radiance, albedo, normal }
        }))
    }

    /// The samples of each half, and who says so.
    pub fn samples(&self) -> &HalfSamples {
        &self.samples
    }

    /// What each half weighs in means of both.
    pub fn weights(&self) -> HalfWeights {
        self.samples.weights()
    }

    /// Rows of the frame.
    pub fn height(&self) -> usize {
        self.resolution.window.height
    }

    /// Columns of the frame.
    pub fn width(&self) -> usize {
        self.resolution.window.width
    }

    /// The frame's pixels in half a's coordinates.
    pub fn placing(&self) -> Placing {
        let radiance = self.resolution.radiance();
        let display = Placing::of(&self.resolution.files[radiance.file], radiance.channels[0]).display;
        Placing { window: self.resolution.window, display }
    }

    /// What is known from headers alone: layers passed over, views that stay, windows that differ.
    pub fn notes(&self) -> &[String] {
        &self.resolution.warnings
    }

    /// The output of this frame: its picture in a copy of half a. Everything that could make the output impossible is
    /// found here.
    ///
    /// # Errors
    /// As [`OutputPlan::of_frame`].
    pub fn output(&self) -> Result<OutputPlan, Error> {
        OutputPlan::of_frame(&self.resolution)
    }

    /// The frame's additive passes, and alpha where it is asked for; all rows are looked at.
    ///
    /// # Errors
    /// As [`OpenPasses::open`].
    pub fn passes(&self, selection: Option<&PassSelection>, alpha: bool) -> Result<OpenPasses, Error> {
        OpenPasses::open(&self.resolution, self.weights(), selection, alpha)
    }

    /// Planes of all roles together.
    pub fn planes(&self) -> usize {
        let read: usize = self.resolution.filled.iter().map(|filled| filled.channels.len()).sum();
        let made = self.made.halves.iter().flatten().count() + self.made.full.iter().count();
        // Where there are further pictures, z is among them once more.
        let again = if self.variants() > 0 { 3 } else { 0 };
        read + 3 * (made + 3 * self.made.variants.len() + again)
    }

    /// How many variants of z the frame has; none where that is z alone.
    pub fn variants(&self) -> usize {
        let further = self.further_in_files() + self.made.variants.len();
        if further > 0 { further + 1 } else { 0 }
    }

    /// Further denoised pictures in the files.
    fn further_in_files(&self) -> usize {
        self.resolution.filled.iter().map(|filled| filled.variant).max().unwrap_or(0)
    }

    /// Which channels fill which role, in the order read.
    pub fn sources(&self) -> Vec<RoleSource> {
        self.resolution.filled.iter().map(|filled| self.resolution.source(filled)).collect()
    }

    /// Some rows of every role: decoded, values as in the files; denoised pictures that were made as they are.
    ///
    /// # Errors
    /// [`Error::Damaged`] and what else reading a file can raise.
    ///
    /// # Panics
    /// When the rows leave the picture, and when denoised halves are neither in the files nor supplied.
    pub fn rows(&self, rows: Range<usize>) -> Result<Frame, Error> {
        // Motion and position are of shots.
        let with_differences = Role::DIFFERENCES.iter().all(|role| self.has(*role, Buffer::A));
        let is_wanted = |role: Role| match role {
            Role::Motion | Role::Position => false,
            Role::Dx | Role::Dy => with_differences,
            _ => true,
        };
        let mut images = self.decode(rows.clone(), |filled| is_wanted(filled.role))?;
        let made = |picture: &CompactImage| picture.rows(rows.clone());
        let further = self.further_in_files();
        let mut variants: Vec<DenoisedVariant> = Vec::new();
        for variant in 1..=further {
            let [a, b, full] =
                [Buffer::A, Buffer::B, Buffer::Full].map(|buffer| images.remove(&(Role::Denoised, buffer, variant)));
            // resolve() has found both halves of each.
            let (Some(a), Some(b)) = (a, b) else { unreachable!("a further denoised picture has both halves") };
            variants.push(DenoisedVariant { halves: [a, b], full });
        }
        variants.extend(self.made.variants.iter().map(|variant| variant.rows(&rows)));
        if let Some(halves) = &self.made.halves {
            for (buffer, picture) in [Buffer::A, Buffer::B].into_iter().zip(halves) {
                images.insert((Role::Denoised, buffer, 0), made(picture));
            }
        }
        let a = take_half(&mut images, Buffer::A);
        let b = take_half(&mut images, Buffer::B);
        let denoised = images.remove(&(Role::Denoised, Buffer::Full, 0)).or_else(|| self.made.full.as_ref().map(made));
        let (Some(a), Some(b)) = (a, b) else { panic!("rows of a frame without denoised halves") };
        if !variants.is_empty() {
            let first = [&a.denoised, &b.denoised].map(Image::clone);
            variants.insert(0, DenoisedVariant { halves: first, full: denoised.clone() });
        }
        let composite = self.made.composite.as_ref().map(|composite| composite.rows(&rows));
        let mut of_half = |half| Some([images.remove(&(Role::Dx, half, 0))?, images.remove(&(Role::Dy, half, 0))?]);
        let differences = of_half(Buffer::A).zip(of_half(Buffer::B)).map(|(a, b)| [a, b]);
        Ok(Frame { a, b, denoised, variants, composite, weights: self.weights(), differences })
    }

    /// Some rows of one role of a buffer, values as in the files; `None` where they do not hold it.
    ///
    /// # Errors
    /// As [`Self::rows`].
    ///
    /// # Panics
    /// When the rows leave the picture.
    pub fn role_rows(&self, role: Role, buffer: Buffer, rows: Range<usize>) -> Result<Option<Image>, Error> {
        let key = (role, buffer, 0);
        let is_it = |filled: &Filled| (filled.role, filled.buffer, filled.variant) == key;
        Ok(self.decode(rows, is_it)?.remove(&key))
    }

    /// Some rows of the denoised pictures of a buffer: z, or its variants in their order. Without one of the full buffer,
    /// the mean of both halves' by their weights.
    ///
    /// # Errors
    /// As [`Self::rows`].
    ///
    /// # Panics
    /// As [`Self::rows`].
    pub fn denoised_rows(&self, buffer: Buffer, rows: Range<usize>) -> Result<Vec<Image>, Error> {
        let mut images =
            self.decode(rows.clone(), |filled| filled.role == Role::Denoised && filled.buffer == buffer)?;
        let made = |picture: &CompactImage| picture.rows(rows.clone());
        let half = |halves: &[CompactImage; 2]| match buffer {
            Buffer::A => Some(made(&halves[0])),
            Buffer::B => Some(made(&halves[1])),
            Buffer::Full => None,
        };
        let first = images.remove(&(Role::Denoised, buffer, 0)).or_else(|| match buffer {
            Buffer::Full => self.made.full.as_ref().map(made),
            _ => self.made.halves.as_ref().and_then(half),
        });
        let mut pictures = vec![first];
        pictures.extend((1..=self.further_in_files()).map(|at| images.remove(&(Role::Denoised, buffer, at))));
        let further = |variant: &MadeVariant| half(&variant.halves).or_else(|| Some(made(&variant.full)));
        pictures.extend(self.made.variants.iter().map(further));
        if pictures.iter().all(Option::is_some) {
            return Ok(pictures.into_iter().flatten().collect());
        }
        assert_eq!(buffer, Buffer::Full, "denoised pictures of a half are in the files or were supplied");
        let halves = self.denoised_rows(Buffer::A, rows.clone())?.into_iter().zip(self.denoised_rows(Buffer::B, rows)?);
        let means = halves.map(|(a, b)| self.weights().mean_of(&a, &b));
        Ok(pictures.into_iter().zip(means).map(|(own, mean)| own.unwrap_or(mean)).collect())
    }

    /// What a person should know of differences of y of which only one direction is there.
    pub fn note_on_differences(&self) -> Option<String> {
        let (there, missing) = match Role::DIFFERENCES.map(|role| self.has(role, Buffer::A)) {
            [true, false] => ("dx", "dy"),
            [false, true] => ("dy", "dx"),
            _ => return None,
        };
        Some(format!("{there} is there and {missing} is not: differences are not used"))
    }

    /// Whether both halves have motion.
    pub fn has_motion(&self) -> bool {
        self.has(Role::Motion, Buffer::A)
    }

    /// Whether both halves have world positions.
    pub fn has_position(&self) -> bool {
        self.has(Role::Position, Buffer::A)
    }

    /// Matrices from the world to the picture in the attributes of a half's files ([`CAMERAS`]), the likeliest first: 16
    /// values each, in the file's order. Where half b's files have none, half a's.
    pub fn cameras(&self, half: Buffer) -> Vec<[f32; 16]> {
        let roles = [(Role::Position, half), (Role::Radiance, half), (Role::Radiance, Buffer::A)];
        let of_role = |(role, buffer)| {
            let Filled { file, channels, .. } = self.resolution.get(role, buffer)?;
            let file = &self.resolution.files[*file];
            Some(file.matrices(file.channels[channels[0]].part, &CAMERAS)).filter(|found| !found.is_empty())
        };
        roles.into_iter().find_map(of_role).unwrap_or_default()
    }

    /// Some rows of the roles that are wanted.
    fn decode(
        &self,
        rows: Range<usize>,
        wanted: impl Fn(&Filled) -> bool + Sync,
    ) -> Result<BTreeMap<Key, Image>, Error> {
        assert!(rows.start < rows.end && rows.end <= self.height(), "rows {rows:?} of {}", self.height());
        let of_file = |at: usize| {
            let of_file = |filled: &&Filled| filled.file == at && wanted(filled);
            let wanted: Vec<_> = self.resolution.filled.iter().filter(of_file).collect();
            let part = |filled: &&Filled| (filled.channels.clone(), filled.window.rows(rows.clone()));
            let images = self.resolution.files[at].windows(&wanted.iter().map(part).collect::<Vec<_>>())?;
            let key = |filled: &Filled| (filled.role, filled.buffer, filled.variant);
            Ok(wanted.into_iter().map(key).zip(images).collect::<Vec<_>>())
        };
        let files = (0..self.resolution.files.len()).into_par_iter();
        let decoded = files.map(of_file).collect::<Result<Vec<_>, Error>>()?;
        Ok(decoded.into_iter().flatten().collect())
    }

    /// An inspection that has looked at nothing yet.
    pub fn inspection(&self) -> Inspection {
        Inspection::new(self.height(), self.width())
    }

    /// Everything a person should know, when `inspection` has looked at all rows.
    ///
    /// # Errors
    /// Halves that cannot be used: identical, or without any finite value.
    pub fn warnings(&self, inspection: &Inspection) -> Result<Vec<String>, Error> {
        let source = |role, buffer| self.resolution.get(role, buffer).map(|filled| self.resolution.source(filled));
        let verdict = inspection.verdict(&source)?;
        let mut warnings = self.resolution.warnings.clone();
        warnings.extend(lossy_inputs(&self.resolution));
        warnings.extend(left_out(&self.resolution));
        warnings.extend(verdict);
        Ok(warnings)
    }
}

/// What an image is: role, buffer and variant.
type Key = (Role, Buffer, usize);

fn take_half(images: &mut BTreeMap<Key, Image>, buffer: Buffer) -> Option<HalfBuffer> {
    Some(HalfBuffer {
        radiance: images.remove(&(Role::Radiance, buffer, 0))?,
        denoised: images.remove(&(Role::Denoised, buffer, 0))?,
        albedo: images.remove(&(Role::Albedo, buffer, 0)),
        normal: images.remove(&(Role::Normal, buffer, 0)),
        visibility: images.remove(&(Role::Visibility, buffer, 0)),
    })
}

impl FrameRows for OpenFrame {
    type Error = Error;

    fn height(&self) -> usize {
        OpenFrame::height(self)
    }

    fn width(&self) -> usize {
        OpenFrame::width(self)
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Frame>, Error> {
        OpenFrame::rows(self, rows).map(Cow::Owned)
    }

    fn has_composite(&self) -> bool {
        self.made.composite.is_some()
    }
}
