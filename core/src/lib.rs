//! The method of self-supervised post-correction, apart from any learning framework and from files.
//!
//! In the order of the data:
//!
//! | module | step |
//! |---|---|
//! | [`same_scene`] | whether both halves show the same things |
//! | [`frame_stats`] | what is decided once for a frame: exposure, features in use |
//! | [`independence`], `shared_noise`, [`alignment`], [`trust`] | whether the halves are what they claim to be, and what is done about it |
//! | [`prepare`] | a frame in the method's units |
//! | [`differences`] | differences of y that a gradient-domain renderer gives |
//! | [`plan`] | what of the picture is computed |
//! | [`start`] | a network's weights before training |
//! | [`objective`] | the self-supervised loss (Eqs. 8, 9) of training tiles, and its gradient |
//! | [`tiles`] | features to parameters, tile by tile |
//! | [`corrector`] | parameters to g_c over a picture |
//! | `residuals` | what a correction is judged by: y of the other half, and its differences |
//! | `blend_weight` | how much of a correction is kept, pixel by pixel |
//! | [`first_or_mean`] | of several networks, the mean or the first |
//! | `lanes` | rows in runs of pixels, for what judges a picture |
//! | `outlier_limit` | fireflies that only the full buffer has |
//! | [`composition`] | what a picture is made of |
//! | [`compose`] | corrected halves to the finished rows |
//! | [`held_out`] | pixels that training leaves out, to judge it by |
//! | [`frame_sums`] | what the whole picture is judged by |
//! | [`estimate`] | the error, told without a reference |
//! | [`fill`] | values of missing pixels |
//! | [`correct`] | all of it: the one way from a frame and a network to the picture |
//! | [`passes`] | additive passes of the picture |
//! | [`useful`] | whether a variant of z says anything of its error |
//! | `unlike` | whether the model suits the frame |
#![forbid(unsafe_code)]

pub mod alignment;
pub mod bands;
pub mod blend_weight;
mod block_sample;
pub mod compose;
mod composite;
pub mod composition;
pub mod correct;
pub mod corrector;
pub mod differences;
pub mod estimate;
mod exposure;
pub mod fill;
pub mod first_or_mean;
pub mod frame_stats;
pub mod frame_sums;
pub mod held_out;
pub mod independence;
mod lanes;
pub mod objective;
pub mod outlier_limit;
pub mod passes;
pub mod plan;
pub mod prepare;
mod residuals;
pub mod rng;
pub mod same_scene;
mod shared_noise;
pub mod start;
mod threads;
pub mod tiles;
pub mod trust;
mod unlike;
pub mod useful;

pub use blend_weight::LARGEST_SHARE;
