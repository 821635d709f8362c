//! From files to a frame that was looked over, whole in memory or read again band by band.

use crate::failure::{Code, Failure};
use rayon::join;
use sspc_core::frame_stats::{Exposure, FrameStats};
use sspc_core::same_scene::{DifferentPlaces, SceneComparison};
use sspc_frames::checks::Inspection;
use sspc_frames::error::Error;
use sspc_frames::samples::HalfSamples;
use sspc_frames::{MadeVariant, OpenFrame};
use sspc_image::{DenoisedVariant, Frame, FrameRows, RoleSource};
use std::borrow::Cow;
use std::ops::Range;

/// Most memory that a frame may take that is held whole; larger ones are read in bands.
const HELD_BYTES: usize = 512 << 20;
/// Rows of a band that is looked over.
const LOOKED_AT: usize = 64;

/// What all rows of a frame take in memory.
pub(crate) fn bytes_of(open: &OpenFrame) -> usize {
    open.planes() * open.height() * open.width() * size_of::<f32>()
}

/// Where a frame's rows come from.
pub enum Source {
    /// Memory.
    Held(Box<Frame>),
    /// Its files, again and again, without the places where the halves show different things.
    Files(Box<OpenFrame>, Option<DifferentPlaces>, Vec<DenoisedVariant>),
}

impl Source {
    /// How many variants of z the frame has.
    pub fn variants(&self) -> usize {
        match self {
            Source::Held(frame) => frame.variants.len(),
            Source::Files(open, _, others) if others.is_empty() => open.variants(),
            Source::Files(.., others) => others.len(),
        }
    }

    /// Puts others in the place of the frame's variants of z.
    pub fn set_variants(&mut self, others: Vec<DenoisedVariant>) {
        match self {
            Source::Held(frame) => frame.variants = others,
            Source::Files(.., variants) => *variants = others,
        }
    }
}

impl Source {
    /// Takes a picture that was put together from denoised passes.
    pub fn set_composite(&mut self, composite: MadeVariant) {
        match self {
            Source::Held(frame) => frame.composite = Some(composite.rows(&(0..frame.height()))),
            Source::Files(open, ..) => open.set_composite(composite),
        }
    }
}

impl FrameRows for Source {
    type Error = Error;

    fn height(&self) -> usize {
        match self {
            Source::Held(frame) => frame.height(),
            Source::Files(open, ..) => open.height(),
        }
    }

    fn width(&self) -> usize {
        match self {
            Source::Held(frame) => frame.width(),
            Source::Files(open, ..) => open.width(),
        }
    }

    fn rows(&self, rows: Range<usize>) -> Result<Cow<'_, Frame>, Error> {
        match self {
            Source::Held(frame) => FrameRows::rows(&**frame, rows).map_err(|never| match never {}),
            Source::Files(open, different, variants) => {
                let mut frame = open.rows(rows.clone())?;
                if !variants.is_empty() {
                    frame.variants = variants.iter().map(|variant| variant.rows(rows.start, rows.len())).collect();
                }
                if let Some(places) = different {
                    places.take_out(&mut frame, rows.start);
                }
                Ok(Cow::Owned(frame))
            }
        }
    }

    fn has_composite(&self) -> bool {
        match self {
            Source::Held(frame) => frame.has_composite(),
            Source::Files(open, ..) => open.has_composite(),
        }
    }
}

/// Whether a frame has as many denoised pictures of each half (`found`; 1 without variants) as a model has networks.
///
/// # Errors
/// Where it has not.
pub fn check_variants(networks: usize, found: usize) -> Result<(), Failure> {
    if networks == found {
        return Ok(());
    }
    let message = format!("the model wants {networks} denoised pictures of each half, found {found}");
    Err(Failure::new(Code::Input, message, "give those that it was fitted with, in their order"))
}

/// A frame in memory that was looked over, wherever it came from.
pub struct InspectedFrame {
    /// The frame, without the places where its halves show different things.
    pub frame: Frame,
    /// What was decided for it.
    pub stats: FrameStats,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Where the halves show different things: left to the denoiser.
    pub different: Option<DifferentPlaces>,
}

impl InspectedFrame {
    /// Looks a frame over; `verdict` says what its inspection comes to.
    ///
    /// # Errors
    /// Halves that cannot be used.
    pub fn of(
        mut frame: Frame,
        exposure: Exposure,
        verdict: impl FnOnce(&Inspection) -> Result<Vec<String>, Error>,
    ) -> Result<Self, Error> {
        let (height, width) = (frame.height(), frame.width());
        let (mut inspection, mut comparison) = (Inspection::new(height, width), SceneComparison::new(height, width));
        let look = || {
            inspection.look(&frame, 0, 0..height);
            comparison.look(&frame);
        };
        let (mut stats, ()) = join(|| FrameStats::of(&frame, exposure), look);
        let mut warnings = verdict(&inspection)?;
        let different = comparison.finish();
        if let Some(places) = &different {
            places.take_out(&mut frame, 0);
            stats = FrameStats::of(&frame, exposure);
            warnings.push(places.warning());
        }
        warnings.extend(stats.found.notes());
        warnings.extend(stats.trust().warning());
        Ok(Self { frame, stats, warnings, different })
    }
}

/// A frame that was looked over.
pub struct ReadFrame {
    /// Its rows.
    pub source: Source,
    /// What was decided for it.
    pub stats: FrameStats,
    /// Which channels fill which role.
    pub roles: Vec<RoleSource>,
    /// The samples of each half.
    pub samples: HalfSamples,
    /// What a person should know.
    pub warnings: Vec<String>,
    /// Where the halves show different things: left to the denoiser.
    pub different: Option<DifferentPlaces>,
}

impl ReadFrame {
    /// Reads a frame, whole when it is small enough, and looks it over.
    ///
    /// # Errors
    /// What reading a file can raise, and halves that cannot be used.
    pub fn read(open: OpenFrame, exposure: Exposure) -> Result<Self, Error> {
        if bytes_of(&open) > HELD_BYTES { Self::in_bands(open, exposure) } else { Self::held(&open, exposure) }
    }

    /// The same, whole whatever its size.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn held(open: &OpenFrame, exposure: Exposure) -> Result<Self, Error> {
        let frame = open.rows(0..open.height())?;
        Self::of_frame(open, frame, exposure)
    }

    /// The same of a frame whose rows were all read.
    ///
    /// # Errors
    /// Halves that cannot be used.
    pub fn of_frame(open: &OpenFrame, frame: Frame, exposure: Exposure) -> Result<Self, Error> {
        let InspectedFrame { frame, stats, mut warnings, different } =
            InspectedFrame::of(frame, exposure, |inspection| open.warnings(inspection))?;
        warnings.extend(stats.note_on_samples(open.samples().counts.is_some()));
        let (source, roles, samples) = (Source::Held(Box::new(frame)), open.sources(), open.samples().clone());
        Ok(Self { source, stats, roles, samples, warnings, different })
    }

    /// The same for a frame of any size: what is looked over is forgotten.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn in_bands(open: OpenFrame, exposure: Exposure) -> Result<Self, Error> {
        let (height, width) = (open.height(), open.width());
        let (mut inspection, mut comparison) = (open.inspection(), SceneComparison::new(height, width));
        let mut inspected = false;
        let mut stats = FrameStats::of_bands(height * width, exposure, |look| {
            for top in (0..height).step_by(LOOKED_AT) {
                let rows = top..(top + LOOKED_AT).min(height);
                // A row more on either side for differences between neighbours.
                let around = rows.start.saturating_sub(1)..(rows.end + 1).min(height);
                let band = open.rows(around.clone())?;
                let own = band.rows(rows.start - around.start, rows.len());
                if !inspected {
                    inspection.look(&band, around.start, rows.clone());
                    comparison.look(&own);
                }
                look(&own);
            }
            inspected = true;
            Ok::<(), Error>(())
        })?;
        let mut warnings = open.warnings(&inspection)?;
        let different = comparison.finish();
        let (roles, samples) = (open.sources(), open.samples().clone());
        let source = Source::Files(Box::new(open), different.clone(), Vec::new());
        if let Some(places) = &different {
            stats = FrameStats::of_bands(height * width, exposure, |look| {
                for top in (0..height).step_by(LOOKED_AT) {
                    look(&*source.rows(top..(top + LOOKED_AT).min(height))?);
                }
                Ok::<(), Error>(())
            })?;
            warnings.push(places.warning());
        }
        warnings.extend(stats.found.notes());
        warnings.extend(stats.trust().warning());
        warnings.extend(stats.note_on_samples(samples.counts.is_some()));
        Ok(Self { source, stats, roles, samples, warnings, different })
    }
}
