//! Why work ends before its end: a failure as the programs have them, or an exception of Python.

use pyo3::prelude::*;
use sspc_cli::{Code, Failure};
use std::cell::RefCell;
use std::process;
use std::sync::OnceLock;

pyo3::import_exception!(sspc._errors, Error);

/// What ended the work.
pub enum Stop {
    /// A message, advice and code.
    Failure(Failure),
    /// KeyboardInterrupt, or what a callback raised.
    Raised(PyErr),
}

impl<E: Into<Failure>> From<E> for Stop {
    fn from(error: E) -> Self {
        Stop::Failure(error.into())
    }
}

impl From<Stop> for PyErr {
    fn from(stop: Stop) -> Self {
        match stop {
            Stop::Failure(Failure { code, message, advice }) => Error::new_err((message, advice, code as u8)),
            Stop::Raised(error) => error,
        }
    }
}

/// Arguments that make no sense.
pub fn nonsense(message: impl Into<String>, advice: &str) -> Stop {
    Stop::Failure(Failure::new(Code::Arguments, message, advice))
}

/// Lets Python handle what it was signalled, Ctrl-C above all.
///
/// # Errors
/// What the handler raises.
pub fn check_signals() -> Result<(), Stop> {
    Python::attach(|py| py.check_signals()).map_err(Stop::Raised)
}

/// Between the parts of longer work: remembers the exception that ended it.
#[derive(Default)]
pub struct Watch {
    raised: RefCell<Option<PyErr>>,
}

impl Watch {
    /// Handles signals, and does `more`; whether the work is to stop.
    pub fn stops(&self, more: impl FnOnce(Python<'_>) -> PyResult<()>) -> bool {
        let outcome = Python::attach(|py| py.check_signals().and_then(|()| more(py)));
        let stops = outcome.is_err();
        if let Err(error) = outcome {
            self.raised.replace(Some(error));
        }
        stops
    }

    /// Passes on what was raised.
    ///
    /// # Errors
    /// That exception.
    pub fn finish(self) -> Result<(), Stop> {
        self.raised.into_inner().map_or(Ok(()), |error| Err(Stop::Raised(error)))
    }
}

/// Refuses a process that was forked after work began in its parent: its copy of the thread pool has no threads, and
/// waiting for them would never end.
///
/// # Errors
/// In such a process.
pub fn check_fork() -> Result<(), Stop> {
    static WORKS_IN: OnceLock<u32> = OnceLock::new();
    let own = process::id();
    if *WORKS_IN.get_or_init(|| own) == own {
        return Ok(());
    }
    let message = "this process was forked from one in which sspc had started its threads";
    let advice = "start workers by multiprocessing.get_context('spawn'), or use sspc in the workers alone";
    Err(Stop::Failure(Failure::new(Code::Run, message, advice)))
}
