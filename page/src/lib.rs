//! Data in, one HTML page out: what was read, what became of it, and pictures to judge it by.
//!
//! The page holds everything it shows and loads nothing: its own markup, style and script (`template/`), three small
//! components of others (`vendor/`), pictures as data URIs, figures as JSON. Whatever comes from files (names of channels,
//! paths, messages) enters as JSON and is put on the page as text, never as markup.
//!
//! | module | step |
//! |---|---|
//! | [`picture`] | the pictures of a frame in 8 bits, and what each is |
//! | [`budget`] | how many bytes a frame's pictures may take |
//! | [`encode`] | pictures as PNG, or as JPEG where PNG is too large |
//! | [`document`] | the page's data, and its text |
#![forbid(unsafe_code)]

pub mod budget;
pub mod document;
pub mod encode;
pub mod picture;

pub use document::{FailedFrame, Page, PageFrame};
pub use encode::EncodeError;
pub use picture::{FramePictures, Picture};
