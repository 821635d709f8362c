//! Which Burn backend trains.

use burn::tensor::Device;
use std::fmt;

/// CPU backends of Burn. Both run the same kernels of ours; they differ in the small tensor work
/// around them and in Burn's own convolutions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Backend {
    /// burn-flex, the maintained CPU backend.
    Flex,
    /// burn-ndarray, deprecated upstream; built with the feature `ndarray`.
    #[cfg(feature = "ndarray")]
    Ndarray,
}

impl Backend {
    /// The device whose tensors the backend computes.
    pub fn device(self) -> Device {
        match self {
            Backend::Flex => Device::flex(),
            #[cfg(feature = "ndarray")]
            #[allow(deprecated)] // the point of the option
            Backend::Ndarray => Device::ndarray(),
        }
    }
}

impl fmt::Display for Backend {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Backend::Flex => "flex",
            #[cfg(feature = "ndarray")]
            Backend::Ndarray => "ndarray",
        })
    }
}
