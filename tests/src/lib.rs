//! What the tests of both programs share; the suite over all crates itself is in `tests/tests`.

pub mod faults;
pub mod frames;
