//! Small made-up frames as files.

use sspc_core::image::Image;
use sspc_core::io::write::write_picture;
use sspc_core::rng::Rng;
use std::path::{Path, PathBuf};

/// The four files of a frame without features: two noisy halves and their denoised pictures.
pub struct SmallFrame {
    pub a: PathBuf,
    pub b: PathBuf,
    pub denoised_a: PathBuf,
    pub denoised_b: PathBuf,
}

impl SmallFrame {
    /// Writes `a.exr`, `b.exr`, `za.exr` and `zb.exr`: a soft pattern, with noise in a and b, blurred in the others.
    ///
    /// # Panics
    /// When the folder cannot be written to.
    pub fn write(folder: &Path, width: usize, height: usize) -> Self {
        let mut rng = Rng::new(7);
        let mut file = |name: &str, noise: f32, blur: f32| {
            let picture = Image::from_fn(3, height, width, |c, y, x| {
                let wave = ((x as f32 + c as f32) * 0.4).sin() * (y as f32 * 0.3).cos();
                (1.0 + blur * wave + noise * rng.normal()).max(0.0)
            });
            let path = folder.join(name);
            write_picture(&path, &[], &picture, &[]).expect("the folder can be written to");
            path
        };
        SmallFrame {
            a: file("a.exr", 0.3, 0.5),
            b: file("b.exr", 0.3, 0.5),
            denoised_a: file("za.exr", 0.01, 0.4),
            denoised_b: file("zb.exr", 0.01, 0.4),
        }
    }

    /// The frame as arguments of `sspc-train fit` and `sspc-infer run`.
    pub fn arguments(&self) -> [&Path; 6] {
        let name = Path::new;
        [&self.a, &self.b, name("--denoised-a"), &self.denoised_a, name("--denoised-b"), &self.denoised_b]
    }
}
