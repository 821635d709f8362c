//! The operator library of sspc: onnxruntime opens it (`RegisterCustomOpsLibrary`) and then knows the operator
//! `sspc.PostCorrection`, by which the graph of `sspc-train export --graph operators` computes g_c. `onnx/README.md` says
//! how an engine uses it.
//!
//! | module | what |
//! |---|---|
//! | [`operator`] | what the operator computes, of which tensors |
//! | `layouts` | types of onnxruntime's C interface |
//! | [`ffi`] | onnxruntime's C interface: all of the crate's `unsafe` |

#![deny(unsafe_code)]

#[allow(unsafe_code)]
pub mod ffi;
mod layouts;
pub mod operator;
