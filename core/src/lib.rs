//! The method of self-supervised post-correction, apart from any learning framework.

pub mod frame;
pub mod image;
