//! From arrays by name to a frame's pictures.

use crate::arrays;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyDict, PyList};
use sspc_arrays::frame::{GivenFrame, PICTURES, name};
use sspc_image::{DenoisedVariant, Image};
use std::collections::BTreeMap;

/// The arrays of a frame as Python hands them over: height, width, the bytes of each by its [`name`], and those of further
/// denoised pictures.
pub type Given<'py> = (usize, usize, Bound<'py, PyDict>, Bound<'py, PyList>);

/// A further denoised picture: of half a, half b, and the full buffer.
type Further = (PyBackedBytes, PyBackedBytes, Option<PyBackedBytes>);

/// The same, owned here alone: the bytes are gone as soon as they are images.
pub struct Arrays {
    height: usize,
    width: usize,
    arrays: BTreeMap<String, PyBackedBytes>,
    further: Vec<Further>,
}

impl Arrays {
    /// Takes the arrays out of Python's dictionary and list.
    ///
    /// # Errors
    /// Values that are no bytes.
    pub fn take((height, width, given, more): Given<'_>) -> PyResult<Self> {
        let (arrays, further) = (given.extract()?, more.extract()?);
        given.clear();
        more.call_method0("clear")?;
        Ok(Arrays { height, width, arrays, further })
    }

    /// The frame's pictures.
    pub fn frame(self) -> GivenFrame {
        let Arrays { height, width, mut arrays, further } = self;
        let image = |bytes: &PyBackedBytes, channels| arrays::image(bytes, channels, height, width);
        let mut frame = GivenFrame::default();
        for (role, buffer) in PICTURES {
            if let Some(bytes) = arrays.remove(&name(role, buffer)) {
                frame.put(role, buffer, image(&bytes, role.channels()));
            }
        }
        let picture = |bytes: PyBackedBytes| -> Image { image(&bytes, 3) };
        for (a, b, full) in further {
            frame.put_denoised(DenoisedVariant { halves: [picture(a), picture(b)], full: full.map(picture) });
        }
        frame
    }
}
