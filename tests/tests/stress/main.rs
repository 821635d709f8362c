//! Numerical stress: inputs at the ends of what f32 and a renderer can bring, through kernels, pictures
//! and training.
//!
//! `cargo test --release --workspace --test stress -- --nocapture --test-threads 1` prints the tables of
//! worst errors; `-- --ignored --nocapture` fits the whole sample frame at several exposures.

mod activations;
mod cases;
mod frames;
mod g_c;
mod loss;
mod missing;
mod network;
mod scale;
mod table;
mod threads;
mod training;
