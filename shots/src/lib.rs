//! What neighbouring frames of a shot give to a frame: m, the temporal mean of z along the motion, which takes the place of
//! z in network and g_c.
//!
//! | module | step |
//! |---|---|
//! | [`convention`] | what a renderer's motion pass means: sign, scale, which components |
//! | [`camera`] | motion of what stands still, from world positions and cameras |
//! | [`flow`] | motion estimated from a half's own pictures, where there is no pass |
//! | [`field`] | displacements: where a pixel lies in another frame |
//! | [`warp`] | pictures sampled along a field: Catmull-Rom for z, bilinear for features |
//! | [`validity`] | how far a pixel of the neighbour shows the same thing, by features |
//! | [`light`] | whether it lies in the same light |
//! | [`mean`] | m_t = (z_t + Σ v W z_f) / (1 + Σ v) |
//! | [`relation`] | neighbours that are left out: another shot, the same picture again, noise shared with the other half |
#![forbid(unsafe_code)]

pub mod camera;
pub mod convention;
pub mod field;
pub mod flow;
pub mod light;
pub mod mean;
pub mod relation;
pub mod validity;
pub mod warp;
