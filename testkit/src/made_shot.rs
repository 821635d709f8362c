//! A made-up shot as files: a texture that moves, with its motion in a pass as Cycles writes it.

use crate::exr_parts::write_seen;
use sspc_core::rng::Rng;
use sspc_image::Image;
use std::path::{Path, PathBuf};

/// Pixels that everything moves from frame to frame, to the right and down.
pub const MOVED: (f32, f32) = (2.5, -1.25);

/// How one frame of the shot differs from the others.
#[derive(Clone, Copy, Debug)]
pub struct MadeFrame {
    /// Its number.
    pub number: i32,
    /// Seeds of the noise of half a and of half b.
    pub seeds: [u64; 2],
    /// Height and width.
    pub size: (usize, usize),
    /// Whether it shows something else.
    pub is_other_scene: bool,
    /// Factor on the motion pass.
    pub motion: f32,
    /// The frame whose world positions are in a pass `P`, if there is one, and the one whose camera is in the attributes.
    pub seen: Option<(i32, Option<i32>)>,
}

impl MadeFrame {
    /// A frame as all others are.
    pub fn new(number: i32) -> Self {
        let seed = 2 * number.unsigned_abs() as u64;
        Self { number, seeds: [seed, seed + 1], size: (96, 128), is_other_scene: false, motion: 1.0, seen: None }
    }

    /// What is seen, without noise, `[3, H, W]`.
    pub fn truth(&self) -> Image {
        let (height, width) = self.size;
        let (dx, dy) = (MOVED.0 * self.number as f32, MOVED.1 * self.number as f32);
        Image::from_fn(3, height, width, |c, y, x| {
            let (x, y, c) = (x as f32 - dx, y as f32 - dy, c as f32);
            let slow = 0.3 * (0.045 * x - 0.06 * y).sin();
            match self.is_other_scene {
                false => {
                    0.7 + slow + 0.25 * (0.31 * x + 0.17 * y + c).sin() + 0.15 * (0.23 * y - 0.11 * x + 2.0 * c).cos()
                }
                true => 0.5 + 0.4 * (0.9 * y + 0.05 * x * y + c).sin(),
            }
        })
    }

    /// World positions `[3, H, W]` of a frame: those of the texture, on the plane z = 0.
    fn positions(&self, number: i32) -> Image {
        let moved = [MOVED.0, MOVED.1].map(|by| by * number as f32);
        let (height, width) = self.size;
        Image::from_fn(3, height, width, |c, y, x| [x as f32 - moved[0], y as f32 - moved[1], 0.0][c])
    }

    /// The camera of a frame, which sees everything along z: (X, Y, Z, 1) times it is in 0..1.
    fn camera(&self, number: i32) -> [f32; 16] {
        let (height, width) = (self.size.0 as f32, self.size.1 as f32);
        let [right, down] = [MOVED.0, MOVED.1].map(|by| by * number as f32 + 0.5);
        let mut matrix = [0.0; 16];
        (matrix[0], matrix[5], matrix[15]) = (1.0 / width, 1.0 / height, 1.0);
        (matrix[12], matrix[13]) = (right / width, down / height);
        matrix
    }

    /// Writes `a.NNNN.exr` and `b.NNNN.exr`: noisy colour, `denoised`, `albedo`, `Vector` with four components,
    /// and `P` where it is asked for.
    ///
    /// # Panics
    /// When the folder cannot be written to.
    pub fn write(&self, folder: &Path) -> [PathBuf; 2] {
        let (height, width) = self.size;
        let truth = self.truth();
        let vector = Image::from_fn(4, height, width, |c, _, _| {
            // Previous - current and current - next, y up; all but constant, so that the pass says something.
            self.motion * [-MOVED.0, MOVED.1, -MOVED.0, MOVED.1][c]
        });
        let vector = {
            let mut vector = vector;
            vector.set(0, 0, 0, 1.01 * vector.at(0, 0, 0));
            vector
        };
        [("a", self.seeds[0]), ("b", self.seeds[1])].map(|(half, seed)| {
            let rng = &mut Rng::new(seed);
            let mut with_noise = |deviation: f32| {
                Image::from_fn(3, height, width, |c, y, x| (truth.at(c, y, x) + deviation * rng.normal()).max(0.0))
            };
            let (radiance, denoised) = (with_noise(0.2), with_noise(0.03));
            let path = folder.join(format!("{half}.{:04}.exr", self.number));
            let mut layers = vec![
                ("", "RGB", &radiance, false),
                ("denoised", "RGB", &denoised, false),
                ("albedo", "RGB", &truth, false),
                ("Vector", "XYZW", &vector, false),
            ];
            let positions = self.seen.map(|(number, _)| self.positions(number));
            layers.extend(positions.as_ref().map(|positions| ("P", "XYZ", positions, false)));
            write_seen(&path, &layers, self.seen.and_then(|seen| seen.1).map(|number| self.camera(number)));
            path
        })
    }
}
