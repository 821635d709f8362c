//! The reader and writer of frames: what is read of whose files, what is refused and how it is said, what is written.

mod errors;
mod roles;
mod sample;
mod shared_frames;
mod write_outputs;
