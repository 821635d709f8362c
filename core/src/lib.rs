//! The method of self-supervised post-correction, apart from any learning framework.

pub mod corrector;
pub mod error;
pub mod estimate;
pub mod features;
pub mod fill;
pub mod finish;
pub mod frame;
pub mod gc;
pub mod image;
pub mod io;
mod judge;
pub mod metric;
pub mod network;
pub mod objective;
pub mod parameters;
pub mod plan;
pub mod prepare;
pub mod rng;
pub mod sequence;
pub mod simd;
pub mod smooth;
pub mod survey;
