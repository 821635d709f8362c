//! Kernels and objective by themselves, and a picture in bands against the whole.

mod bands;
mod differences;
mod kernels;
mod means;
mod negative;
mod objective;
mod passes;
mod variants;
mod weights;
