//! `fit`: arrays to a fitted model, by the functions of `sspc-train fit`.

use crate::frame::{Arrays, Given};
use crate::model::{Model, TOOL};
use crate::report::{FitReport, Known};
use crate::stop::{Stop, Watch, check_fork, check_signals, nonsense};
use clap::ValueEnum;
use pyo3::prelude::*;
use sspc_cli::reading::InspectedFrame;
use sspc_kernels::network::Network;
use sspc_kernels::simd::Isa;
use sspc_train::backend::Backend;
use sspc_train::fit::{Control, Limits, StepRecord};
use sspc_train::fit_command::{initial_networks, leave_out_useless};
use sspc_train::fits::fit_variants;
use sspc_train::fitted_model::fitted_model;
use sspc_train::inputs::prepare;
use sspc_train::preset::{Preset, Settings};
use sspc_train::report::skipped;
use sspc_train::{setting_overrides, warm_start};
use std::slice;
use std::time::Duration;

/// One step of training, as told to the callback.
#[pyclass(frozen, get_all, module = "sspc")]
pub struct Step {
    /// From 1.
    step: usize,
    /// Steps that are planned.
    of: usize,
    /// Mean loss of the step's tiles.
    loss: f64,
    /// Learning rate.
    rate: f64,
    /// Seconds since training began.
    seconds: f64,
}

#[pymethods]
impl Step {
    fn __repr__(&self) -> String {
        let Step { step, of, loss, rate, seconds } = self;
        format!("Step(step={step}, of={of}, loss={loss:.6}, rate={rate:.6}, seconds={seconds:.3})")
    }
}

impl From<&StepRecord> for Step {
    fn from(&StepRecord { step, of, loss, rate, seconds }: &StepRecord) -> Self {
        Step { step, of, loss, rate, seconds }
    }
}

/// Fits a model to one frame.
#[pyfunction]
#[pyo3(signature = (frame, *, preset, seed, steps, time_limit, changes, init, progress))]
#[allow(clippy::too_many_arguments, reason = "Python's keyword arguments")]
pub fn fit(
    py: Python<'_>,
    frame: Given<'_>,
    preset: &str,
    seed: u64,
    steps: Option<usize>,
    time_limit: Option<f64>,
    changes: Vec<String>,
    init: Option<Py<Model>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<Model> {
    let how = Request { preset: preset.to_string(), seed, steps, time_limit, changes, init, progress };
    let frame = Arrays::take(frame)?;
    Ok(py.detach(|| how.run(frame))?)
}

struct Request {
    preset: String,
    seed: u64,
    steps: Option<usize>,
    time_limit: Option<f64>,
    changes: Vec<String>,
    init: Option<Py<Model>>,
    progress: Option<Py<PyAny>>,
}

impl Request {
    fn run(&self, frame: Arrays) -> Result<Model, Stop> {
        check_fork()?;
        let isa = Isa::from_env()?;
        let (mut settings, warm) = self.settings()?;
        let limits = self.limits()?;
        let InspectedFrame { frame, stats, mut warnings, .. } = frame.frame()?.inspect(settings.exposure)?;
        let stats = stats.with_features_of(settings.features);
        check_signals()?;
        let (mut prepared, _, said) = prepare(frame, &stats, &settings);
        warnings.extend(said);
        warnings.extend(leave_out_useless(slice::from_mut(&mut prepared), warm.is_some(), 0));
        check_signals()?;
        let initial = initial_networks(warm, &mut settings, slice::from_ref(&prepared))?;
        let watch = Watch::default();
        let fitted = fit_variants(&[&prepared], &settings, initial, &limits, Backend::Flex, isa, |record| {
            if watch.stops(|py| self.tell(py, record)) { Control::Stop } else { Control::Continue }
        });
        watch.finish()?;
        let model = fitted_model(&settings, &fitted, prepared.set, prepared.differences.is_some(), Vec::new(), TOOL)?;
        let known = Known { size: (prepared.height(), prepared.width()), stats, skipped: skipped(&prepared), warnings };
        Model::fitted(model, &FitReport::new(isa, settings, known, &fitted))
    }

    fn tell(&self, py: Python<'_>, record: &StepRecord) -> PyResult<()> {
        let Some(progress) = &self.progress else { return Ok(()) };
        progress.call1(py, (Step::from(record),)).map(drop)
    }

    /// How to train, and the networks of a model to start from.
    fn settings(&self) -> Result<(Settings, Option<Vec<Network>>), Stop> {
        let preset = Preset::from_str(&self.preset, false).map_err(|_| {
            let known: Vec<String> = Preset::value_variants().iter().map(Preset::to_string).collect();
            nonsense(format!("preset '{}': expected {}", self.preset, known.join(", ")), "balanced is the default")
        })?;
        let mut settings = Settings::of(preset, self.seed);
        setting_overrides::apply(&self.changes, &mut settings, self.init.is_some())?;
        let warm = self.init.as_ref().map(|model| warm_start::begin(model.get().onnx(), &mut settings));
        Ok((settings, warm))
    }

    fn limits(&self) -> Result<Limits, Stop> {
        let wrong = |seconds| nonsense(format!("time_limit {seconds}: expected a positive number of seconds"), "");
        let duration = |seconds| {
            let duration = Duration::try_from_secs_f64(seconds).ok().filter(|limit| !limit.is_zero());
            duration.ok_or_else(|| wrong(seconds))
        };
        Ok(Limits { steps: self.steps, time: self.time_limit.map(duration).transpose()? })
    }
}
