//! The self-supervised loss (Eqs. 8, 9) of tiles of a frame, and its gradient.
//!
//! Half a is corrected and compared with the y of half b, and the other way round. The denominator is
//! made of the z of one half: of that compared with in the paper, of the corrected one in the other
//! presets ([`own_weight`] says why).
//!
//! Differences of y that a gradient-domain renderer gives are compared with those of the correction
//! ([`DifferenceTarget`]).
//!
//! [`Objective::loss`] gives the gradient by a network's outputs; [`Step::run`] takes each tile through the network,
//! the loss and back in one go.

mod differences;
mod loss;
mod step;
mod tile;
mod weight;

pub use differences::{DifferenceTarget, difference_weight};
pub use loss::{HalfObjective, Objective, PixelLoss, Scratch};
pub use step::{Step, Workspaces, parts_of_tile};
pub use tile::{Mirror, Tile};
pub use weight::{own_weight, relative_weight, triple, weight_of};

/// Added to the squared mean radiance in every relative error.
pub const RELATIVE_FLOOR: f32 = sspc_image::REL_L2_EPSILON as f32;
