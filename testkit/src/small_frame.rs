//! Small made-up frames as files.

use crate::exr_parts::write_picture;
use sspc_core::rng::Rng;
use sspc_image::Image;
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
            write_picture(&path, &picture);
            path
        };
        SmallFrame {
            a: file("a.exr", 0.3, 0.5),
            b: file("b.exr", 0.3, 0.5),
            denoised_a: file("za.exr", 0.01, 0.4),
            denoised_b: file("zb.exr", 0.01, 0.4),
        }
    }

    /// Writes albedo, normal and visibility for both halves, noisy too; they are arguments of `--role`.
    ///
    /// # Panics
    /// When the folder cannot be written to.
    pub fn write_features(&self, folder: &Path, width: usize, height: usize) -> Vec<String> {
        let mut rng = Rng::new(8);
        let mut file = |role: &str| {
            let picture = Image::from_fn(3, height, width, |c, y, x| {
                0.3 + 0.3 * ((x / 9 + y / 7 + c) % 2) as f32 + 0.1 * rng.uniform()
            });
            let path = folder.join(role).with_extension("exr");
            write_picture(&path, &picture);
            path
        };
        let roles = ["albedo-a", "albedo-b", "normal-a", "normal-b", "visibility-a", "visibility-b"];
        let channels = |role: &str| if role.starts_with("visibility") { ":R" } else { "" };
        roles.map(|role| format!("{role}={}{}", file(role).display(), channels(role))).to_vec()
    }

    /// The frame as arguments of `sspc-train fit` and `sspc-infer run`.
    pub fn arguments(&self) -> [&Path; 6] {
        let name = Path::new;
        [&self.a, &self.b, name("--denoised-a"), &self.denoised_a, name("--denoised-b"), &self.denoised_b]
    }
}
