//! A frame whose headers are read and whose rows are decoded when they are asked for, so that memory need not grow with
//! the picture.

use crate::align::Placing;
use crate::checks::{Inspection, lossy_inputs};
use crate::error::Error;
use crate::files::FrameFiles;
use crate::output::OutputPlan;
use crate::overrides::RoleOverrides;
use crate::resolve::{Filled, Resolution, resolve};
use rayon::prelude::*;
use sspc_image::{Buffer, Frame, FrameRows, HalfBuffer, Image, Role, RoleSource};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::ops::Range;

/// Files whose channels are known to make a frame.
pub struct OpenFrame {
    resolution: Resolution,
}

impl OpenFrame {
    /// Finds the roles, reading headers only.
    ///
    /// # Errors
    /// As [`resolve`].
    pub fn open(files: &FrameFiles, overrides: &RoleOverrides) -> Result<Self, Error> {
        Ok(Self { resolution: resolve(files, overrides)? })
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

    /// Planes of all roles together.
    pub fn planes(&self) -> usize {
        self.resolution.filled.iter().map(|filled| filled.channels.len()).sum()
    }

    /// Which channels fill which role, in the order read.
    pub fn sources(&self) -> Vec<RoleSource> {
        self.resolution.filled.iter().map(|filled| self.resolution.source(filled)).collect()
    }

    /// Decodes some rows of every role, values as in the files.
    ///
    /// # Errors
    /// [`Error::Damaged`] and what else reading a file can raise.
    ///
    /// # Panics
    /// When the rows leave the picture.
    pub fn rows(&self, rows: Range<usize>) -> Result<Frame, Error> {
        assert!(rows.start < rows.end && rows.end <= self.height(), "rows {rows:?} of {}", self.height());
        let of_file = |at: usize| {
            let wanted: Vec<_> = self.resolution.filled.iter().filter(|filled| filled.file == at).collect();
            let part = |filled: &&Filled| (filled.channels.clone(), filled.window.rows(rows.clone()));
            let images = self.resolution.files[at].windows(&wanted.iter().map(part).collect::<Vec<_>>())?;
            Ok(wanted.into_iter().map(|filled| (filled.role, filled.buffer)).zip(images).collect::<Vec<_>>())
        };
        let files = (0..self.resolution.files.len()).into_par_iter();
        let decoded = files.map(of_file).collect::<Result<Vec<_>, Error>>()?;
        let mut images: BTreeMap<(Role, Buffer), Image> = decoded.into_iter().flatten().collect();
        let a = take_half(&mut images, Buffer::A);
        let b = take_half(&mut images, Buffer::B);
        let denoised = images.remove(&(Role::Denoised, Buffer::Full));
        let (Some(a), Some(b)) = (a, b) else {
            // resolve() has refused frames without colour or denoised colour.
            unreachable!("a resolved frame has both halves");
        };
        Ok(Frame { a, b, denoised, variants: Vec::new() })
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
        warnings.extend(verdict);
        Ok(warnings)
    }
}

fn take_half(images: &mut BTreeMap<(Role, Buffer), Image>, buffer: Buffer) -> Option<HalfBuffer> {
    Some(HalfBuffer {
        radiance: images.remove(&(Role::Radiance, buffer))?,
        denoised: images.remove(&(Role::Denoised, buffer))?,
        albedo: images.remove(&(Role::Albedo, buffer)),
        normal: images.remove(&(Role::Normal, buffer)),
        visibility: images.remove(&(Role::Visibility, buffer)),
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
}
