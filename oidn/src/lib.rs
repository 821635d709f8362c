//! Runs the user's own Open Image Denoise (OIDN), which is opened at run time: nothing of it is linked or shipped, and a
//! machine without it runs the same programs.
//!
//! | module | what |
//! |---|---|
//! | [`search`] | where the library may lie |
//! | `ffi` | the library's functions; the only unsafe code here |
//! | [`mode`] | which features guide it, and how long it may take |
//! | [`buffers`] | a picture as the library takes it: interleaved, without NaN and Inf |
//! | [`library`] | from a path to a denoised picture |
//! | [`error`] | what can go wrong |
#![deny(unsafe_code)]

pub mod buffers;
pub mod error;
#[expect(unsafe_code, reason = "a C library is called")]
mod ffi;
pub mod library;
pub mod mode;
pub mod search;

pub use buffers::{Picture, Rows};
pub use error::OidnError;
pub use library::{Denoised, Oidn, Run, Version};
pub use mode::{Mode, Quality};
