//! The Rust side against the parity cases of the PyTorch reference (`tests/cases`), in f32 against
//! its f64, for every instruction set that this machine has.
//!
//! Each tolerance is a named constant beside its reason; each test also says, and limits, the
//! smallest relative error of a constant or an input that it would catch.

mod activations;
mod differences;
mod first_difference;
mod g_c;
mod loss;
mod metric;
mod network;
mod refusals;
mod shot;
