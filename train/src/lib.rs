//! Fits the corrector to a frame or a shot with Burn.

pub mod operation;
