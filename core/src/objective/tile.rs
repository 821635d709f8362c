//! Tiles of a picture, and their mirror images.

use sspc_kernels::region::Region;

/// A tile to correct: which half, where, and how the network sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Tile {
    /// 0 or 1.
    pub half: usize,
    /// Where it lies in the picture.
    pub region: Region,
    /// How the network sees it.
    pub mirror: Mirror,
}

impl Tile {
    /// The tile as it lies in the picture.
    pub fn upright(half: usize, region: Region) -> Self {
        Self { half, region, mirror: Mirror::default() }
    }
}

/// The eight mirror images of a tile. The network's features and outputs are mirrored, g_c and the loss
/// are not: Ω_c is symmetric, so the best parameters of a pixel stay the same, and a network that sees
/// eight times as many tiles learns less of their noise by heart.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Mirror {
    /// The last row first.
    pub rows: bool,
    /// The last column first.
    pub columns: bool,
    /// Then rows as columns: of square tiles only.
    pub diagonal: bool,
}

impl Mirror {
    /// Mirrors planes of `height` x `width` in place.
    ///
    /// # Panics
    /// When a plane that is not square is to be mirrored at its diagonal.
    pub fn apply(self, planes: &mut [f32], height: usize, width: usize) {
        self.for_each_plane(planes, height, width, |plane| {
            self.flip(plane, height, width);
            self.transpose(plane, width);
        });
    }

    /// What [`Self::apply`] did, undone.
    ///
    /// # Panics
    /// As there.
    pub fn undo(self, planes: &mut [f32], height: usize, width: usize) {
        self.for_each_plane(planes, height, width, |plane| {
            self.transpose(plane, width);
            self.flip(plane, height, width);
        });
    }

    fn for_each_plane(self, planes: &mut [f32], height: usize, width: usize, change: impl Fn(&mut [f32])) {
        assert!(!self.diagonal || height == width, "{height} x {width} is not square");
        if self != Mirror::default() {
            planes.chunks_exact_mut((height * width).max(1)).for_each(change);
        }
    }

    fn flip(self, plane: &mut [f32], height: usize, width: usize) {
        match (self.rows, self.columns) {
            // Both are one turn by 180 degrees.
            (true, true) => plane.reverse(),
            (true, false) => {
                let (upper, lower) = plane.split_at_mut(height.div_ceil(2) * width);
                let pairs = upper.chunks_exact_mut(width).zip(lower.chunks_exact_mut(width).rev());
                pairs.for_each(|(a, b)| a.swap_with_slice(b));
            }
            (false, true) => plane.chunks_exact_mut(width).for_each(<[f32]>::reverse),
            (false, false) => {}
        }
    }

    fn transpose(self, plane: &mut [f32], side: usize) {
        if self.diagonal {
            for (y, x) in (0..side).flat_map(|y| (0..y).map(move |x| (y, x))) {
                plane.swap(y * side + x, x * side + y);
            }
        }
    }
}
