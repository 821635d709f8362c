//! The fitted model: corrects arrays by the functions of `sspc-infer run`, and is the same file.

use crate::arrays;
use crate::frame::{Arrays, Given};
use crate::report::FitReport;
use crate::stop::{Stop, Watch, check_fork, check_signals, nonsense};
use pyo3::prelude::*;
use pyo3::types::{PyByteArray, PyBytes};
use serde::Serialize;
use sspc_arrays::correct::{CorrectedFrame, correct_frame};
use sspc_arrays::model::{of_bytes, of_file};
use sspc_arrays::watch::{Watch as Progress, watched};
use sspc_cli::{Code, Failure};
use sspc_core::correct::Corrected;
use sspc_frames::atomic::atomic_write_bytes;
use sspc_image::Image;
use sspc_onnx::{Contract, write_image, write_network};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// What fitted models say they were fitted by.
pub const TOOL: &str = concat!("sspc for Python ", env!("CARGO_PKG_VERSION"));

/// How long a correction goes on before it looks for signals again.
const BETWEEN_SIGNALS: Duration = Duration::from_millis(100);

/// A fitted network with its contract, and the report of its fit where this process fitted it.
#[pyclass(frozen, module = "sspc._native")]
pub struct Model {
    model: sspc_onnx::Model,
    /// JSON.
    report: Option<String>,
}

/// A picture, the share of the correction in it, and its report as JSON.
type Picture<'py> = (Bound<'py, PyByteArray>, Bound<'py, PyByteArray>, String);

impl Model {
    /// A model that was fitted just now.
    ///
    /// # Errors
    /// A report that is no JSON.
    pub fn fitted(model: sspc_onnx::Model, report: &FitReport) -> Result<Self, Stop> {
        Ok(Model { model, report: Some(json(report)?) })
    }

    /// Contract and weights.
    pub fn onnx(&self) -> &sspc_onnx::Model {
        &self.model
    }

    fn correct_frame(&self, frame: Arrays, strength: f32) -> Result<(Image, Image, String), Stop> {
        check_fork()?;
        let (watch, mut asked) = (Watch::default(), Instant::now());
        let stops = |_| {
            // The work waits, and the GIL may be busy.
            if asked.elapsed() < BETWEEN_SIGNALS {
                return false;
            }
            asked = Instant::now();
            watch.stops(|_| Ok(()))
        };
        let work = |progress: &Progress| correct_frame(frame.frame()?, &self.model, strength, true, progress);
        let corrected = watched(None, stops, work);
        watch.finish()?;
        let CorrectedFrame { corrected, report } = corrected?;
        check_signals()?;
        let report = json(&report)?;
        let Corrected { picture, maps, .. } = corrected;
        let share = maps.map_or_else(|| Image::zeros(1, picture.height(), picture.width()), |maps| maps.share);
        Ok((picture, share, report))
    }

    fn graph(&self, name: &str) -> Result<Vec<u8>, Stop> {
        match name {
            "network" => Ok(write_network(&self.model)),
            "image" => Ok(write_image(&self.model)),
            _ => Err(nonsense(format!("graph '{name}': expected network, image"), "")),
        }
    }
}

#[pymethods]
impl Model {
    #[staticmethod]
    fn load(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let model = py.detach(|| of_file(&path)).map_err(Stop::from)?;
        Ok(Model { model, report: None })
    }

    #[staticmethod]
    fn from_bytes(bytes: &[u8], report: Option<String>) -> PyResult<Self> {
        Ok(Model { model: of_bytes(bytes).map_err(Stop::from)?, report })
    }

    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &write_network(&self.model))
    }

    fn save(&self, py: Python<'_>, path: PathBuf, graph: &str) -> PyResult<()> {
        let written = py.detach(|| Ok(atomic_write_bytes(&path, &[], &self.graph(graph)?)?));
        written.map_err(|stop: Stop| stop.into())
    }

    fn correct<'py>(&self, py: Python<'py>, frame: Given<'py>, strength: f32) -> PyResult<Picture<'py>> {
        let frame = Arrays::take(frame)?;
        let (picture, share, report) = py.detach(|| self.correct_frame(frame, strength))?;
        Ok((arrays::bytes(py, &picture)?, arrays::bytes(py, &share)?, report))
    }

    /// JSON, or None for a model that was loaded.
    #[getter]
    fn report(&self) -> Option<&str> {
        self.report.as_deref()
    }

    #[getter]
    fn preset(&self) -> &str {
        &self.contract().preset
    }

    #[getter]
    fn seed(&self) -> u64 {
        self.contract().seed
    }

    #[getter]
    fn steps(&self) -> u64 {
        self.contract().steps
    }

    #[getter]
    fn features(&self) -> Vec<String> {
        self.contract().features.iter().map(|role| role.name().to_string()).collect()
    }
}

impl Model {
    fn contract(&self) -> &Contract {
        &self.model.contract
    }
}

fn json(report: &impl Serialize) -> Result<String, Stop> {
    let failure = |error| Failure::new(Code::Run, format!("cannot write the report: {error}"), "");
    Ok(serde_json::to_string(report).map_err(failure)?)
}
