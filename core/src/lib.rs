//! The method of self-supervised post-correction, apart from any learning framework and from files.
#![forbid(unsafe_code)]

pub mod corrector;
pub mod estimate;
pub mod fill;
pub mod finish;
mod judge;
pub mod native;
pub mod objective;
pub mod plan;
pub mod prepare;
pub mod rng;
pub mod smooth;
pub mod start;
pub mod survey;
