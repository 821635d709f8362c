//! What both programs say and take alike.
//!
//! | module | what |
//! |---|---|
//! | [`frame_args`] | the arguments that name a frame, or the frames of a shot |
//! | [`run_args`] | how much is printed, threads, strength |
//! | [`denoising`] | denoised pictures that the files do not hold |
//! | [`denoised_passes`] | the same of additive passes, and what they make together |
//! | [`passes`] | additive passes beside the picture |
//! | [`reading`] | from files to a frame that was looked over |
//! | [`shot`] | the same of a frame of a shot, with its neighbours |
//! | [`failure`] | how a command ends: messages and exit codes |
//! | [`interrupt`] | Ctrl-C and SIGTERM |
//! | [`output`] | lines and bars |
//! | [`openjd`] | progress, status and failure as messages to a render farm |
//! | [`record`] | what reports and pictures record: roles, provenance, memory |
#![forbid(unsafe_code)]

pub mod denoised_passes;
pub mod denoising;
pub mod failure;
pub mod frame_args;
pub mod interrupt;
pub mod openjd;
pub mod output;
pub mod passes;
mod print;
pub mod reading;
pub mod record;
pub mod run_args;
pub mod shot;

pub use denoising::{DenoiserReport, Denoising, UnaskedModes};
pub use failure::{Code, Failure};
pub use frame_args::{FrameArgs, FrameJob};
pub use run_args::{ProgressFormat, RunArgs, Verbosity};
pub use sspc_oidn::{Mode, Quality};
