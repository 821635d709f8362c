//! Tiles of a picture, and their mirror images.

use crate::gc::Region;

/// A tile to correct: which half, where, and how the network sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    pub half: usize,
    pub region: Region,
    pub mirror: Mirror,
}

impl Tile {
    /// The tile as it lies in the picture.
    pub fn upright(half: usize, region: Region) -> Self {
        Self { half, region, mirror: Mirror::default() }
    }
}

/// Mirror images of a tile. The network's features and outputs are mirrored, g_c and the loss are
/// not: Ω_c is symmetric, so the best parameters of a pixel stay the same, and a network that sees
/// four times as many tiles learns less of their noise by heart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mirror {
    /// The last row first.
    pub rows: bool,
    /// The last column first.
    pub columns: bool,
}

impl Mirror {
    /// Mirrors planes of `height` x `width` in place; twice is as before.
    pub fn apply(self, planes: &mut [f32], height: usize, width: usize) {
        for plane in planes.chunks_exact_mut((height * width).max(1)) {
            match self {
                // Both are one turn by 180 degrees.
                Mirror { rows: true, columns: true } => plane.reverse(),
                Mirror { rows: true, columns: false } => {
                    let (upper, lower) = plane.split_at_mut(height.div_ceil(2) * width);
                    let pairs = upper.chunks_exact_mut(width).zip(lower.chunks_exact_mut(width).rev());
                    pairs.for_each(|(a, b)| a.swap_with_slice(b));
                }
                Mirror { rows: false, columns: true } => plane.chunks_exact_mut(width).for_each(<[f32]>::reverse),
                Mirror { rows: false, columns: false } => return,
            }
        }
    }
}
