//! Memory for vectors.

use std::ops::{Deref, DerefMut};

/// Bytes of a cache line.
const LINE: usize = 64;

/// Floats that begin on a cache line, so that vectors of the widest instruction set do not straddle two.
#[derive(Debug)]
pub(crate) struct Aligned {
    data: Vec<f32>,
    start: usize,
}

impl Aligned {
    /// `floats` zeros.
    pub fn zeros(floats: usize) -> Self {
        let data = vec![0.0; floats + LINE / size_of::<f32>()];
        let start = data.as_ptr().align_offset(LINE).min(data.len() - floats);
        Self { data, start }
    }
}

impl Deref for Aligned {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        &self.data[self.start..]
    }
}

impl DerefMut for Aligned {
    fn deref_mut(&mut self) -> &mut [f32] {
        &mut self.data[self.start..]
    }
}
