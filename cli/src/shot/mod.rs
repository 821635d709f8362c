//! Frames of a shot with their neighbours: each read once, its z replaced by the temporal mean along the motion.
//!
//! | module | what |
//! |---|---|
//! | [`settings`] | how many neighbours, and what the motion pass means |
//! | `side` | one buffer of a frame, from memory or from files |
//! | `means` | a frame's temporal means |
//! | [`report`] | what was done with each neighbour |

mod means;
pub mod report;
pub mod settings;
mod side;

use crate::denoising::{DenoiserReport, Denoising};
use crate::failure::{Code, Failure};
use crate::frame_args::ShotFiles;
use crate::reading::{ReadFrame, bytes_of};
use report::NeighbourReport;
use settings::ShotSettings;
use side::{Decoded, Sides};
use sspc_core::frame_stats::Exposure;
use sspc_frames::{OpenFrame, RoleOverrides};
use std::cell::RefCell;
use std::sync::Arc;

/// Most memory that the decoded frames of a shot may take, a frame and its neighbours: larger ones are read again for each
/// use, one buffer at a time.
const DECODED_BYTES: usize = 900 << 20;

/// A shot whose frames are read with their neighbours.
pub struct Shot<'a> {
    files: ShotFiles,
    settings: ShotSettings,
    denoising: &'a Denoising<'a>,
    /// Frames that were decoded.
    decoded: RefCell<Vec<(Key, Arc<Decoded>)>>,
}

/// Number of a frame, and its view.
type Key = (i32, Option<String>);

/// Where a frame's own rows are to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Residence {
    /// In memory, whatever its size.
    Memory,
    /// In memory where it is small enough, else read in bands.
    AsFits,
}

/// A frame of a shot that was looked over, with its means in the place of its pictures' variants.
pub struct ShotFrame {
    /// The frame.
    pub frame: ReadFrame,
    /// Which denoised pictures were made, where the files do not hold them.
    pub denoiser: Option<DenoiserReport>,
    /// What was done with each neighbour, the nearest first.
    pub neighbours: Vec<NeighbourReport>,
}

impl<'a> Shot<'a> {
    /// The shot of these files; what they do not hold is denoised.
    pub fn new(files: ShotFiles, settings: ShotSettings, denoising: &'a Denoising<'a>) -> Self {
        Self { files, settings, denoising, decoded: RefCell::default() }
    }

    /// What it is read by.
    pub fn settings(&self) -> &ShotSettings {
        &self.settings
    }

    /// Finds a frame's roles, motion among them.
    ///
    /// # Errors
    /// As [`OpenFrame::open_to_denoise`].
    pub fn open(&self, number: i32, overrides: &RoleOverrides) -> Result<OpenFrame, Failure> {
        Ok(OpenFrame::open_to_denoise(&self.files.of(number), &overrides.clone().with_motion())?)
    }

    /// Reads a frame whose roles were found by [`Self::open`], and what its neighbours give to it.
    ///
    /// # Errors
    /// What reading and denoising the frame itself can raise; neighbours that cannot be read are left out.
    pub fn read(
        &self,
        number: i32,
        mut open: OpenFrame,
        overrides: &RoleOverrides,
        exposure: Exposure,
        residence: Residence,
    ) -> Result<ShotFrame, Failure> {
        let (mut frame, denoiser, found) = if self.holds(&open) {
            let decoded = self.decode(number, &mut open, overrides)?;
            let frame = ReadFrame::of_frame(&open, decoded.frame.clone(), exposure)?;
            let denoiser = decoded.denoiser.clone();
            let neighbours = self.neighbours(number, overrides, true)?;
            (frame, denoiser, means::of_frame(&Sides::Decoded(decoded), &neighbours, &self.settings)?)
        } else {
            let denoiser = self.denoising.supply(&mut open)?;
            let sides = Sides::Files(Box::new(open));
            let found = means::of_frame(&sides, &self.neighbours(number, overrides, false)?, &self.settings)?;
            let Sides::Files(open) = sides else { unreachable!("as made above") };
            let frame = match residence {
                Residence::Memory => ReadFrame::held(&open, exposure)?,
                Residence::AsFits => ReadFrame::read(*open, exposure)?,
            };
            (frame, denoiser, found)
        };
        if let Some(variants) = found.variants {
            frame.source.set_variants(variants);
        }
        frame.warnings.extend(found.warnings);
        self.forget(number);
        Ok(ShotFrame { frame, denoiser, neighbours: found.reports })
    }

    /// Looks at a frame's motion pass and its neighbours, for the search of what the pass means. Nothing is said of frames
    /// without a pass, or that cannot be read.
    ///
    /// # Errors
    /// Interruption.
    pub fn look_for_motion(
        &self,
        number: i32,
        overrides: &RoleOverrides,
        search: &mut settings::MotionSearch,
    ) -> Result<(), Failure> {
        let Ok(mut open) = self.open(number, overrides) else { return Ok(()) };
        if !open.has_motion() || !self.holds(&open) {
            return Ok(());
        }
        let centre = match self.decode(number, &mut open, overrides) {
            Ok(centre) => centre,
            Err(failure) if failure.code == Code::Interrupted => return Err(failure),
            Err(_) => return Ok(()),
        };
        for neighbour in self.neighbours(number, overrides, true)? {
            if let (1, Ok(Some(Sides::Decoded(decoded)))) = (neighbour.offset.abs(), &neighbour.sides) {
                means::look_for_motion(&centre, decoded, neighbour.offset, search);
            }
        }
        self.forget(number);
        Ok(())
    }

    /// Whether a frame and its neighbours fit the memory.
    fn holds(&self, open: &OpenFrame) -> bool {
        bytes_of(open) * (2 * self.settings.extra_frames + 1) <= DECODED_BYTES
    }

    /// The neighbours within reach, those of each distance before and after the frame.
    fn neighbours(
        &self,
        number: i32,
        overrides: &RoleOverrides,
        whole: bool,
    ) -> Result<Vec<means::Neighbour>, Failure> {
        let distances = 1..=self.settings.extra_frames as i32;
        let offsets = distances.flat_map(|distance| [-distance, distance]);
        let mut found = Vec::new();
        for (offset, other) in offsets.filter_map(|offset| Some((offset, number.checked_add(offset)?))) {
            let sides = self.sides(other, overrides, whole);
            match sides {
                Err(failure) if failure.code == Code::Interrupted => return Err(failure),
                sides => found.push(means::Neighbour { number: other, offset, sides }),
            }
        }
        Ok(found)
    }

    /// A neighbour's buffers, where its files exist.
    fn sides(&self, number: i32, overrides: &RoleOverrides, whole: bool) -> Result<Option<Sides>, Failure> {
        if !self.files.of(number).a.exists() {
            return Ok(None);
        }
        let mut open = self.open(number, overrides)?;
        Ok(Some(match whole {
            true => Sides::Decoded(self.decode(number, &mut open, overrides)?),
            false => {
                self.denoising.supply(&mut open)?;
                Sides::Files(Box::new(open))
            }
        }))
    }

    /// A frame's pictures, decoded now or before.
    fn decode(&self, number: i32, open: &mut OpenFrame, overrides: &RoleOverrides) -> Result<Arc<Decoded>, Failure> {
        let key = (number, overrides.view().map(str::to_string));
        let known = self.decoded.borrow().iter().find(|(own, _)| *own == key).map(|(_, decoded)| decoded.clone());
        if let Some(decoded) = known {
            return Ok(decoded);
        }
        let denoiser = self.denoising.supply(open)?;
        let decoded = Arc::new(Decoded::read(open, denoiser)?);
        self.decoded.borrow_mut().push((key, decoded.clone()));
        Ok(decoded)
    }

    /// Lets go of the frames that the next one has no use for.
    fn forget(&self, number: i32) {
        let (number, reach) = (i64::from(number), self.settings.extra_frames as i64);
        let is_near = |other: i32| (number - reach + 1..=number + reach).contains(&i64::from(other));
        self.decoded.borrow_mut().retain(|((other, _), _)| is_near(*other));
    }
}
