//! The extension module `sspc._native`: what the Python package does in Rust.
//!
//! `sspc/__init__.py` checks arguments and arrays and hands them over as bytes; the way from there to the picture is the
//! programs': the same functions, in the same order.
//!
//! | module | what |
//! |---|---|
//! | `arrays` | bytes of Python to planar images, and back |
//! | `frame` | named arrays to a frame's pictures |
//! | `fitting` | `fit` |
//! | `model` | the fitted model: correct, load, save |
//! | `report` | what is told of a fit |
//! | `evaluation` | `evaluate` |
//! | `stop` | failures, Ctrl-C, callbacks that raise |

#![forbid(unsafe_code)]

mod arrays;
mod evaluation;
mod fitting;
mod frame;
mod model;
mod report;
mod stop;

/// What Python imports.
#[pyo3::pymodule]
mod _native {
    #[pymodule_export]
    use crate::evaluation::evaluate;
    #[pymodule_export]
    use crate::fitting::{Step, fit};
    #[pymodule_export]
    use crate::model::Model;
}
