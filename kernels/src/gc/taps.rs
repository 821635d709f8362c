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

    /// Offsets (dy, dx).
    pub fn list(&self) -> &[(i32, i32)] {
        &self.offsets
    }

    /// Number of taps.
    pub fn len(&self) -> usize {
        self.offsets.len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.offsets.is_empty()
    }

    /// Largest offset in either direction.
    pub fn radius(&self) -> usize {
        self.offsets.iter().map(|(dy, dx)| dy.unsigned_abs().max(dx.unsigned_abs()) as usize).max().unwrap_or(0)
    }

    /// The taps by the row that they lie in: those of a pixel in the rows from its own downward, and
    /// those of the pixels there that point back.
    pub(super) fn pairs(&self) -> Vec<RowPairs> {
        let radius = self.radius() as i32;
        let pairs = |dy: i32| {
            let first = if dy == 0 { 1 } else { -radius };
            let pair = |dx: i32| Pair {
                dx: dx as isize,
                down: self.offsets.contains(&(dy, dx)),
                up: self.offsets.contains(&(-dy, -dx)),
            };
            (first..=radius).map(pair).filter(|p| p.down || p.up).collect()
        };
        (0..=radius).map(|dy| RowPairs { dy: dy as isize, pairs: pairs(dy) }).filter(|r| !r.pairs.is_empty()).collect()
    }
}

/// Pairs of pixels of which the lower lies `dy` rows below the upper.
pub(super) struct RowPairs {
    pub dy: isize,
    pub pairs: Vec<Pair>,
}

/// Pixels at x in the upper row and x + dx in the lower one, that take part in one another's sums.
pub(super) struct Pair {
    pub dx: isize,
    /// The lower is a tap of the upper.
    pub down: bool,
    /// The upper is a tap of the lower.
    pub up: bool,
}
