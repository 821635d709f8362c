//! Errors of a picture against a reference: relL2, SMAPE, PSNR, SSIM, ꟻLIP; of the change between two frames; and of a video.
//!
//! [`relative`] works on radiance; [`displayed`], [`flip`] and [`video`] on what a viewer sees, through
//! [`sspc_image::display`]; [`summary`] is all of them at once, [`comparison`] those of two pictures. All sums are f64 in a fixed order, so that
//! results do not depend on the number of threads; non-finite pixels are left out and counted.

#![forbid(unsafe_code)]

pub mod comparison;
pub mod displayed;
pub mod filter;
pub mod flip;
pub mod relative;
pub mod summary;
pub mod temporal;
pub mod video;

pub use comparison::Comparison;
pub use relative::{Measured, brightness, rel_l2, rel_l2_gain, smape};
pub use summary::{Figures, figures};
pub use temporal::temporal_error;
pub use video::Video;
