//! Burn against our kernels: its own convolutions and autodiff, its backends, its training.

mod convolutions;
mod engines;
mod fits;
mod step;
mod training;

use sspc_train::backend::Backend;

/// Every backend that is built in.
const BACKENDS: [Backend; 2] = [Backend::Flex, Backend::Ndarray];
