//! Files in, frames out; pictures in, files out.
//!
//! | module | step |
//! |---|---|
//! | [`files`] | which files make a frame: two halves, one file with both, the paper's folders |
//! | [`overrides`] | the user's word on which channel is what |
//! | [`exr_file`] | headers of one OpenEXR file, with limits on what a header may claim |
//! | `decode` | its chunks to planes |
//! | [`names`] | the names that renderers give to the roles |
//! | [`layers`] | a file's channels as layers, and the search for a role among them |
//! | [`resolve`] | roles to channels of files |
//! | [`open`] | a frame whose rows are read as they are needed |
//! | [`read`] | whole frames, references and pictures |
//! | [`checks`] | identical halves, correlated neighbours, lossy input, absent features |
//! | [`atomic`] | outputs that appear whole or not at all |
//! | [`temporary`] | the files they are until then, and what killed processes left of them |
//! | [`write`](mod@write) | the corrected picture inside a copy of the input |
//! | [`preview`] | tone curve, error colours, PNG |
//! | [`sequence`] | frame numbers in file names |

#![forbid(unsafe_code)]

pub mod atomic;
pub mod checks;
mod decode;
pub mod error;
pub mod exr_file;
pub mod files;
pub mod layers;
pub mod names;
pub mod open;
pub mod overrides;
pub mod preview;
pub mod read;
pub mod resolve;
pub mod sequence;
pub mod temporary;
pub mod write;

pub use atomic::atomic_write;
pub use files::FrameFiles;
pub use open::OpenFrame;
pub use overrides::RoleOverrides;
pub use read::{read_frame, read_picture, read_reference};
pub use write::write_corrected;
