//! Corrects frames with a fitted model: tract runs the network over tiles, core finishes the
//! picture.
#![forbid(unsafe_code)]

pub mod cli;
pub mod clock;
pub mod engine;
pub mod evaluate;
pub mod evaluate_shot;
pub mod flicker;
pub mod info;
pub mod run;
pub mod shot_plot;
pub mod shot_table;
pub mod shot_video;
pub mod svg;
