//! Fits the corrector to a frame or a shot with Burn.
//!
//! | module | step |
//! |---|---|
//! | [`cli`] | what can be asked |
//! | [`inputs`] | files to frames in the method's units |
//! | [`preset`], [`setting_overrides`] | how to train |
//! | [`tiles`], `importance` | on what to train |
//! | [`warm_start`] | where to start, when from a model |
//! | [`fit`] | the loop: tiles, loss, gradient, Adam |
//! | [`fits`] | one fit for each variant of z |
//! | [`model`], [`backend`] | the part that is Burn's |
//! | [`combination`] | g_c, or f_c as its special case |
//! | [`divergence_guard`] | keeps the weights finite |
//! | [`outcome`] | the corrected frame |
//! | [`report`] | what is told of it |
//! | [`fitted_model`], [`write`](mod@write), [`page`], [`output_folder`] | what a fit leaves behind |
//! | [`fit_command`], [`export`], [`progress`] | the commands |
#![forbid(unsafe_code)]

pub mod backend;
pub mod cli;
pub mod combination;
pub mod divergence_guard;
pub mod export;
pub mod fit;
pub mod fit_command;
pub mod fits;
pub mod fitted_model;
mod importance;
pub mod inputs;
pub mod model;
pub mod outcome;
pub mod output_folder;
pub mod page;
pub mod preset;
pub mod progress;
pub mod report;
pub mod setting_overrides;
pub mod tiles;
pub mod warm_start;
pub mod write;
