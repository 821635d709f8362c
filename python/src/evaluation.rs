//! `evaluate`: the figures of `sspc-infer evaluate`.

use crate::arrays;
use crate::stop::{Stop, check_fork, nonsense};
use pyo3::prelude::*;
use pyo3::pybacked::PyBackedBytes;
use sspc_cli::{Code, Failure};
use sspc_frames::preview::auto_exposure;
use sspc_image::{Image, Reference};
use sspc_metrics::{Comparison, Figures, figures};

/// relL2 and its standard error, brightness, SMAPE, PSNR, SSIM, FLIP, pixels measured and left out.
type FigureValues = (f64, f64, f64, f64, f64, f64, f64, u64, u64);
/// The denoiser's figures, ratio, ratio across the reference's halves and its standard error.
type ComparisonValues = (FigureValues, f64, f64, f64);

/// Exposure, the picture's figures, and the denoiser's beside them.
type Evaluation = (f32, FigureValues, Option<ComparisonValues>);

/// Measures a picture, and the denoiser's beside it, against a reference.
#[pyfunction]
#[pyo3(signature = (size, *, picture, reference, halves, denoised, exposure))]
pub fn evaluate(
    py: Python<'_>,
    size: (usize, usize),
    picture: PyBackedBytes,
    reference: PyBackedBytes,
    halves: Option<(PyBackedBytes, PyBackedBytes)>,
    denoised: Option<PyBackedBytes>,
    exposure: Option<f32>,
) -> PyResult<Evaluation> {
    let image = |bytes: &PyBackedBytes| arrays::image(bytes, 3, size.0, size.1);
    let measured = py.detach(|| {
        check_fork()?;
        let halves = halves.as_ref().map(|(a, b)| [image(a), image(b)]);
        let reference = Reference { mean: image(&reference), halves };
        measure(&image(&picture), &reference, denoised.as_ref().map(image).as_ref(), exposure)
    });
    Ok(measured?)
}

fn measure(
    picture: &Image,
    reference: &Reference,
    denoised: Option<&Image>,
    exposure: Option<f32>,
) -> Result<Evaluation, Stop> {
    if let Some(exposure) = exposure.filter(|exposure| !(exposure.is_finite() && *exposure > 0.0)) {
        return Err(nonsense(format!("exposure {exposure}: expected a number above 0"), ""));
    }
    let exposure = exposure.unwrap_or_else(|| auto_exposure(&reference.mean));
    let own = figures(picture, reference, exposure);
    if own.pixels == 0 {
        let message = "picture: expected pixels that are finite in it and in reference, found none";
        return Err(Failure::new(Code::Input, message, "one of the two holds only NaN or infinity").into());
    }
    let beside = denoised.map(|denoised| Comparison::of(picture, &own, denoised, reference, exposure));
    let beside = beside.map(|Comparison { figures, rel_l2_ratio, crossed_ratio, crossed_ratio_standard_error }| {
        (values(&figures), rel_l2_ratio, crossed_ratio, crossed_ratio_standard_error)
    });
    Ok((exposure, values(&own), beside))
}

fn values(figures: &Figures) -> FigureValues {
    let Figures { rel_l2, rel_l2_standard_error, brightness, smape, psnr, ssim, flip, pixels, excluded } = *figures;
    (rel_l2, rel_l2_standard_error, brightness, smape, psnr, ssim, flip, pixels, excluded)
}
