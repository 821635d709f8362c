//! The pixels i ≠ c of the window Ω_c that take part in a sum.

/// Offsets (dy, dx) from the centre, the centre itself left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Taps {
    offsets: Vec<(i32, i32)>,
}

impl Taps {
    /// The whole square window of `radius`, row by row.
    pub fn square(radius: usize) -> Self {
        let r = radius as i32;
        let offsets =
            (-r..=r).flat_map(|dy| (-r..=r).map(move |dx| (dy, dx))).filter(|&offset| offset != (0, 0)).collect();
        Self { offsets }
    }

    /// Any set of offsets.
    pub fn from_offsets(offsets: Vec<(i32, i32)>) -> Self {
        Self { offsets: offsets.into_iter().filter(|&offset| offset != (0, 0)).collect() }
    }

    pub fn list(&self) -> &[(i32, i32)] {
        &self.offsets
    }

    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }

    /// Largest offset in either direction.
    pub fn radius(&self) -> usize {
        self.offsets.iter().map(|(dy, dx)| dy.unsigned_abs().max(dx.unsigned_abs()) as usize).max().unwrap_or(0)
    }

    /// Offsets in floats for rows that are `stride` floats apart.
    pub(super) fn offsets(&self, stride: usize) -> Vec<isize> {
        self.offsets.iter().map(|&(dy, dx)| dy as isize * stride as isize + dx as isize).collect()
    }
}
