//! The model contract of sspc: what a fitted model is, the ONNX graphs that it is exported as, and the reader of both.
//! `README.md` beside this crate describes it for other engines.
#![forbid(unsafe_code)]

mod apart;
mod builder;
mod contract;
mod error;
mod image_graph;
mod messages;
mod metadata;
mod model;
mod network_graph;
mod picture;
mod reader;
mod window_sum;

pub use contract::{
    ACTIVATIONS, CONTRACT_VERSION, Contract, MAX_LAYERS, MAX_NETWORKS, PADDING, exposure_rule, form_name,
};
pub use error::{Error, FileError};
pub use image_graph::write_image;
pub use model::Model;
pub use network_graph::write_network;
pub use picture::{DOMAIN, DOMAIN_VERSION, POST_CORRECTION, RADIUS_ATTRIBUTE, write_operators, write_picture};
pub use reader::{GraphKind, MAX_FILE_BYTES, load_model, load_model_and_kind, read_graph_kind, read_model};
