//! Arrays of Python as bytes, f32 of little-endian order, interleaved `(H, W, C)`; here they are planar images.

use pyo3::prelude::*;
use pyo3::types::PyByteArray;
use rayon::prelude::*;
use sspc_image::Image;

const F32: usize = size_of::<f32>();

/// Bytes to a planar image `[channels, height, width]`.
///
/// # Panics
/// When there are not as many as the shape needs.
pub fn image(bytes: &[u8], channels: usize, height: usize, width: usize) -> Image {
    assert_eq!(bytes.len(), F32 * channels * height * width, "bytes of {height}x{width}x{channels}");
    let (values, _) = bytes.as_chunks::<F32>();
    Image::from_rows(channels, height, width, |c, y, row| {
        let of_row = values[channels * y * width..].chunks_exact(channels);
        row.iter_mut().zip(of_row).for_each(|(value, pixel)| *value = f32::from_le_bytes(pixel[c]));
    })
}

/// A planar image to bytes that Python may change.
///
/// # Errors
/// When memory runs out.
pub fn bytes<'py>(py: Python<'py>, image: &Image) -> PyResult<Bound<'py, PyByteArray>> {
    let (channels, width) = (image.channels(), image.width());
    PyByteArray::new_with(py, F32 * image.data().len(), |bytes| {
        bytes.par_chunks_exact_mut(F32 * channels * width).enumerate().for_each(|(y, row)| {
            let (values, _) = row.as_chunks_mut::<F32>();
            for c in 0..channels {
                let pixels = values.iter_mut().skip(c).step_by(channels);
                pixels.zip(image.row(c, y)).for_each(|(to, value)| *to = value.to_le_bytes());
            }
        });
        Ok(())
    })
}
