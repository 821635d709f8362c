//! Training with Burn against training with PyTorch: the same weights, tiles, order and rates.

mod preset;
mod steps;
mod train;
