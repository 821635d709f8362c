//! The arithmetic of the method, for each instruction set: g_c (Eqs. 10, 11) and the network of 3x3 convolutions,
//! forward and backward, each with a naive f64 twin. The only crate with `unsafe`.

mod aligned;
pub mod features;
pub mod gc;
pub mod loss;
pub mod network;
pub mod parameters;
pub mod parts;
pub mod region;
pub mod simd;
pub mod windows;
