//! Fits the corrector to a frame or a shot with Burn.
//!
//! [`preset`] says how, [`tiles`] on what, [`fit`] does it; [`model`] and [`operation`] are the
//! Burn side of core's kernels.

pub mod backend;
pub mod fit;
pub mod model;
pub mod operation;
pub mod preset;
pub mod tiles;
