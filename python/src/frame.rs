//! From arrays by name to a frame's pictures.

use crate::arrays;
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use pyo3::types::{PyDict, PyList};
use sspc_arrays::frame::{DIFFERENCES, GivenFrame, PICTURES, name};
use sspc_cli::Failure;
use sspc_image::{DenoisedVariant, Image};
use std::collections::BTreeMap;

/// The arrays of a frame as Python hands them over: height, width, the bytes of each by its [`name`], those of further
/// denoised pictures, and the samples of half a and half b where they are known.
pub type Given<'py> = (usize, usize, Bound<'py, PyDict>, Bound<'py, PyList>, Option<[f64; 2]>);

/// A further denoised picture: of half a, half b, and the full buffer.
type Further = (PyBackedBytes, PyBackedBytes, Option<PyBackedBytes>);

/// The same, owned here alone: the bytes are gone as soon as they are images.
pub struct Arrays {
    height: usize,
    width: usize,
    arrays: BTreeMap<String, PyBackedBytes>,
    further: Vec<Further>,
    samples: Option<[f64; 2]>,
}

impl Arrays {
    /// Takes the arrays out of Python's dictionary and list.
    ///
    /// # Errors
    /// Values that are no bytes.
    pub fn take((height, width, given, more, samples): Given<'_>) -> PyResult<Self> {
        let (arrays, further) = (given.extract()?, more.extract()?);
        given.clear();
        more.call_method0("clear")?;
        Ok(Arrays { height, width, arrays, further, samples })
    }

    /// The frame's pictures.
    ///
    /// # Errors
    /// Samples that no two halves have.
    pub fn frame(self) -> Result<GivenFrame, Failure> {
        let Arrays { height, width, mut arrays, further, samples } = self;
        let image = |bytes: &PyBackedBytes, channels| arrays::image(bytes, channels, height, width);
        let mut frame = GivenFrame::default();
        samples.map_or(Ok(()), |samples| frame.weigh(samples))?;
        for (role, buffer) in PICTURES.into_iter().chain(DIFFERENCES) {
            if let Some(bytes) = arrays.remove(&name(role, buffer)) {
                frame.put(role, buffer, image(&bytes, role.channels()));
            }
        }
        let picture = |bytes: PyBackedBytes| -> Image { image(&bytes, 3) };
        for (a, b, full) in further {
            frame.put_denoised(DenoisedVariant { halves: [picture(a), picture(b)], full: full.map(picture) });
        }
        Ok(frame)
    }
}
