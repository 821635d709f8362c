//! Frames in memory, corrected as `sspc-infer run` corrects files: what the Python package and the C interface share.
//!
//! | module | what |
//! |---|---|
//! | [`frame`] | pictures by name to a frame that was looked over |
//! | [`model`] | a fitted model from a file or from bytes |
//! | [`correct`](mod@correct) | from both to the picture |
//! | [`report`] | what is told of a picture |
//! | [`watch`] | how far work has got, told on the thread that waits for it |
#![forbid(unsafe_code)]

pub mod correct;
pub mod frame;
pub mod model;
pub mod report;
pub mod watch;
