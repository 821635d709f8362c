//! Corrects frames with a fitted model: tract runs the network over tiles, core finishes the
//! picture.
#![forbid(unsafe_code)]

pub mod engine;
