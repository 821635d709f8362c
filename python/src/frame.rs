//! From named arrays to a frame that was looked over.

use crate::arrays;
use crate::stop::Stop;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::PyDict;
use sspc_cli::reading::InspectedFrame;
use sspc_core::frame_stats::Exposure;
use sspc_image::{Buffer, Frame, HalfBuffer, Image, Role, RoleSource};
use std::collections::BTreeMap;

/// The arrays of a frame as Python hands them over: height, width, and the bytes of each by its [`argument`].
pub type Given<'py> = (usize, usize, Bound<'py, PyDict>);

/// The same, owned here alone: the bytes are gone as soon as they are images.
pub struct Arrays(usize, usize, BTreeMap<String, PyBackedBytes>);

/// What Python's signatures and messages call a role of a buffer.
fn argument(role: Role, buffer: Buffer) -> String {
    match (role, buffer) {
        (Role::Radiance, half) => half.name().to_string(),
        (role, Buffer::Full) => role.name().to_string(),
        (role, half) => format!("{}_{}", role.name(), half.name()),
    }
}

impl Arrays {
    /// Takes the arrays out of Python's dictionary.
    ///
    /// # Errors
    /// Values that are no bytes.
    pub fn take((height, width, given): Given<'_>) -> PyResult<Self> {
        let arrays = given.extract()?;
        given.clear();
        Ok(Arrays(height, width, arrays))
    }

    /// The frame, looked over as the programs do with files.
    ///
    /// # Errors
    /// Halves that cannot be used.
    pub fn inspect(self, exposure: Exposure) -> Result<InspectedFrame, Stop> {
        let source = |role: Role, buffer: Buffer| {
            let channels = ["R", "G", "B"].map(String::from).to_vec();
            Some(RoleSource { role, buffer, path: argument(role, buffer).into(), channels, variant: 0 })
        };
        let (frame, mut notes) = self.frame();
        let inspected = InspectedFrame::of(frame, exposure, |inspection| inspection.verdict(&source))?;
        notes.extend(inspected.warnings);
        Ok(InspectedFrame { warnings: notes, ..inspected })
    }

    /// The frame, and a note for each feature that only one half has: it cannot be used.
    fn frame(self) -> (Frame, Vec<String>) {
        let Arrays(height, width, mut given) = self;
        let mut notes = Vec::new();
        for role in Role::FEATURES {
            let [a, b] = [Buffer::A, Buffer::B].map(|half| (half, argument(role, half)));
            for ((half, own), (_, other)) in [(&a, &b), (&b, &a)] {
                if given.contains_key(own) && !given.contains_key(other) {
                    given.remove(own);
                    notes.push(format!("{role}: only {half} has it ({own}), so it is not used"));
                }
            }
        }
        let mut take = |role: Role, buffer: Buffer| -> Option<Image> {
            let bytes = given.remove(&argument(role, buffer))?;
            Some(arrays::image(&bytes, role.channels(), height, width))
        };
        let mut half = |buffer: Buffer| HalfBuffer {
            radiance: take(Role::Radiance, buffer).expect("Python's signatures ask for it"),
            denoised: take(Role::Denoised, buffer).expect("Python's signatures ask for it"),
            albedo: take(Role::Albedo, buffer),
            normal: take(Role::Normal, buffer),
            visibility: take(Role::Visibility, buffer),
        };
        let (a, b) = (half(Buffer::A), half(Buffer::B));
        (Frame { a, b, denoised: take(Role::Denoised, Buffer::Full), variants: Vec::new() }, notes)
    }
}
