//! Files in, frames out; pictures in, files out.
//!
//! | module | step |
//! |---|---|
//! | [`files`] | which files make a frame: two halves, one file with both, the paper's folders |
//! | [`overrides`] | the user's word on which channel is what |
//! | `container` | the bytes of an OpenEXR file: headers as they are, chunks, a copy with pictures in it |
//! | [`exr_file`] | one OpenEXR file: its channels by name, and their pixels |
//! | [`names`], `halves` | the names that renderers give to the roles, and the marks of halves |
//! | [`layers`], `search` | a file's channels as layers, and the search for a role among them |
//! | [`resolve`] | roles to channels of files |
//! | [`passes`] | additive passes, found and checked |
//! | [`align`], [`window`] | pictures of one frame over each other |
//! | [`open`] | a frame whose rows are read as they are needed |
//! | [`read`] | references and pictures |
//! | [`checks`] | identical halves, correlated neighbours, lossy input, absent features |
//! | [`atomic`] | outputs that appear whole or not at all |
//! | [`temporary`] | the files they are until then, and what killed processes left of them |
//! | [`output`], `place` | the corrected picture inside a copy of half a |
//! | [`preview`] | tone curve, error colours, PNG |
//! | [`samples`] | how many samples each half has |
//! | [`sequence`] | frame numbers in file names |

#![forbid(unsafe_code)]

pub mod align;
pub mod atomic;
pub mod checks;
mod container;
pub mod error;
pub mod exr_file;
pub mod files;
mod halves;
pub mod layers;
pub mod names;
pub mod open;
pub mod output;
pub mod overrides;
pub mod passes;
mod place;
pub mod preview;
pub mod read;
pub mod resolve;
pub mod samples;
mod search;
pub mod sequence;
pub mod temporary;
pub mod window;

pub use atomic::atomic_write;
pub use files::{DenoisedFile, FrameFiles, MoreDenoised};
pub use open::{Made, MadeVariant, OpenFrame};
pub use output::OutputPlan;
pub use overrides::RoleOverrides;
pub use passes::{OpenPasses, PassSelection};
pub use read::{read_picture, read_reference};
pub use window::Window;
