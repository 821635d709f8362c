//! Our ONNX graphs as burn-onnx imports them.

/// The network graph.
#[allow(clippy::all, unused)]
pub mod network {
    include!(concat!(env!("OUT_DIR"), "/graphs/network.rs"));
}

/// The image graph.
#[allow(clippy::all, unused)]
pub mod image {
    include!(concat!(env!("OUT_DIR"), "/graphs/image.rs"));
}
