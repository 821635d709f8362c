//! How far a picture is from its reference.
//!
//! [`relative`] works on radiance; [`displayed`] on what a viewer sees, through
//! [`crate::io::preview::display`]; [`summary`] is all of them at once. All sums are f64 in a fixed order, so that
//! results do not depend on the machine's threads; non-finite pixels are left out and counted.

pub mod relative;

pub use relative::{Measured, rel_l2, smape};
