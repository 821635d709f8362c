//! The reader and writer of frames: what is read of whose files, what is refused and how it is said, what is written.

mod errors;
mod roles;
mod sample;
mod second_reader;
mod shared_frames;
mod unfinished;
mod write_outputs;
