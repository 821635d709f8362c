//! The C interface of sspc. C programs read `include/sspc.h`, which is written from these modules; how to use it stands
//! in `README.md`.
//!
//! | module | what |
//! |---|---|
//! | [`types`] | the structures and constants of the interface |
//! | [`sized`] | structures that may grow: what of them the caller knows |
//! | [`buffers`] | the caller's buffers to planar images, and back |
//! | [`outcome`] | error codes and texts; no panic leaves the library |
//! | [`model`] | models: loaded, described, freed |
//! | [`threads`] | threads of a call's own |
//! | [`correct`] | a frame corrected |

pub mod buffers;
pub mod correct;
pub mod model;
pub mod outcome;
pub mod sized;
pub mod threads;
pub mod types;
