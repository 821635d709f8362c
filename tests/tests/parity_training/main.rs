//! Training with Burn against training with PyTorch: the same weights, tiles, order and rates.

#[path = "../parity/case.rs"]
mod case;
mod preset;
mod steps;
mod train;
