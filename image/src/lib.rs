//! Planar images, and what a frame consists of: the types that files and method share.
#![forbid(unsafe_code)]

mod box_mean;
mod compact;
mod display;
mod epsilon;
mod frame;
mod image;
mod role;
mod rows;
mod shown;
mod storage;
mod weights;

pub use box_mean::box_mean;
pub use compact::CompactImage;
pub use display::display;
pub use epsilon::REL_L2_EPSILON;
pub use frame::{DenoisedVariant, Frame, HalfBuffer, Reference, RoleSource};
pub use image::Image;
pub use role::{Buffer, Role};
pub use rows::FrameRows;
pub use shown::shown;
pub use storage::Storage;
pub use weights::HalfWeights;
