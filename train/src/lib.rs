//! Fits the corrector to a frame or a shot with Burn.
//!
//! [`inputs`] reads, [`preset`] says how ([`experiment`] changes it) and [`tiles`] on what to train,
//! [`fit`] trains, [`guard`] keeps its weights finite, [`write`] leaves picture, model, report and
//! previews; [`model`] and [`operation`] are the Burn side of core's kernels.

pub mod backend;
pub mod cli;
pub mod combination;
pub mod error;
pub mod experiment;
pub mod fit;
pub mod fit_command;
pub mod guard;
mod importance;
pub mod init;
pub mod inputs;
pub mod interrupt;
pub mod model;
pub mod operation;
pub mod output;
pub mod preset;
pub mod progress;
pub mod report;
pub mod tiles;
pub mod write;
