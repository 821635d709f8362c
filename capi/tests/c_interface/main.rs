//! The C interface as its callers meet it.
//!
//! | module | what |
//! |---|---|
//! | `files` | a frame as files, models, and the program's picture |
//! | `buffers`, `frame` | the same frame in memory, laid out as hosts keep it |
//! | `pixels` | pictures are the program's, bit for bit |
//! | `calls` | progress, stopping, what is refused |
//! | `programs` | C programs, compiled and run under the sanitizers |

mod buffers;
mod calls;
mod files;
mod frame;
mod pixels;
mod programs;
