//! Which files make a frame.

use crate::error::{Error, Purpose};
use sspc_image::{Buffer, Role};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The files of one frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FrameFiles {
    /// Half a, or both halves when `b` is absent.
    pub a: PathBuf,
    /// Half b; `None` when the layers of `a` hold both halves (even/odd, names ending in A and B).
    pub b: Option<PathBuf>,
    /// Files that hold one role of one buffer each, beside the above: denoised halves, the denoised
    /// full buffer, features.
    pub roles: BTreeMap<(Role, Buffer), PathBuf>,
    /// Further denoised pictures of the same samples, in the order of the models that are fitted to them.
    pub more_denoised: Vec<MoreDenoised>,
    /// The reference, if there is one.
    pub reference: Option<PathBuf>,
    /// Samples per pixel of half a and of half b, where the user names them.
    pub samples: Option<[u32; 2]>,
}

/// What a further denoiser, or the same with other settings, made of a frame.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MoreDenoised {
    /// Of half a and of half b.
    pub halves: [DenoisedFile; 2],
    /// Of the full buffer.
    pub full: Option<DenoisedFile>,
}

/// A file with a denoised picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DenoisedFile {
    /// The file.
    pub path: PathBuf,
    /// The layer; recognised without it.
    pub layer: Option<String>,
}

impl FrameFiles {
    /// Two files, one per half.
    pub fn halves(a: impl Into<PathBuf>, b: impl Into<PathBuf>) -> Self {
        Self { b: Some(b.into()), ..Self::both_in_one(a) }
    }

    /// One file whose layers hold both halves.
    pub fn both_in_one(file: impl Into<PathBuf>) -> Self {
        Self {
            a: file.into(),
            b: None,
            roles: BTreeMap::new(),
            more_denoised: Vec::new(),
            reference: None,
            samples: None,
        }
    }

    /// Takes `role` of `buffer` from a file of its own.
    pub fn with_role(mut self, role: Role, buffer: Buffer, file: impl Into<PathBuf>) -> Self {
        self.roles.insert((role, buffer), file.into());
        self
    }

    /// Adds the denoised halves and the denoised full buffer, each where given.
    pub fn with_denoised(self, a: Option<PathBuf>, b: Option<PathBuf>, full: Option<PathBuf>) -> Self {
        [(Buffer::A, a), (Buffer::B, b), (Buffer::Full, full)].into_iter().fold(
            self,
            |files, (buffer, file)| match file {
                Some(file) => files.with_role(Role::Denoised, buffer, file),
                None => files,
            },
        )
    }

    /// Adds further denoised pictures.
    pub fn with_more_denoised(mut self, more: Vec<MoreDenoised>) -> Self {
        self.more_denoised.extend(more);
        self
    }

    /// Says how many samples the halves have.
    pub fn with_samples(mut self, samples: Option<[u32; 2]>) -> Self {
        self.samples = samples.or(self.samples);
        self
    }

    /// Adds the reference.
    pub fn with_reference(mut self, file: Option<PathBuf>) -> Self {
        self.reference = file.or(self.reference);
        self
    }

    /// The folders of the paper's published data:
    /// `<root>/input/<denoiser>/<scene>/<scene>_<spp>spp_{randImgA, denoImgA, albedoA, ...}.exr` and
    /// `<root>/target/<scene>/<scene>_ref.exr`.
    ///
    /// Features, the denoised full buffer and the reference are taken when their files exist.
    ///
    /// # Errors
    /// [`Error::MissingFile`] when the scene's folder does not exist.
    pub fn paper_layout(root: &Path, scene: &str, spp: u32, denoiser: &str) -> Result<Self, Error> {
        let folder = root.join("input").join(denoiser).join(scene);
        let file = |name: &str| folder.join(format!("{scene}_{spp}spp_{name}.exr"));
        if !folder.is_dir() {
            return Err(Error::MissingFile { path: folder, purpose: Purpose::Role(Role::Radiance, Buffer::A) });
        }
        let mut files = Self::halves(file("randImgA"), file("randImgB"));
        for (buffer, suffix) in [(Buffer::A, "A"), (Buffer::B, "B")] {
            files = files.with_role(Role::Denoised, buffer, file(&format!("denoImg{suffix}")));
            for (role, stem) in [(Role::Albedo, "albedo"), (Role::Normal, "normal"), (Role::Visibility, "visibility")] {
                let feature = file(&format!("{stem}{suffix}"));
                if feature.exists() {
                    files = files.with_role(role, buffer, feature);
                }
            }
        }
        let full = file("denoImg");
        if full.exists() {
            files = files.with_role(Role::Denoised, Buffer::Full, full);
        }
        let reference = root.join("target").join(scene).join(format!("{scene}_ref.exr"));
        Ok(files.with_reference(reference.exists().then_some(reference)))
    }

    /// Every file that reading this frame may open: none of them may be an output.
    pub fn all(&self) -> Vec<PathBuf> {
        let halves = std::iter::once(&self.a).chain(&self.b);
        let more =
            self.more_denoised.iter().flat_map(|more| more.halves.iter().chain(&more.full)).map(|file| &file.path);
        halves.chain(self.roles.values()).chain(&self.reference).chain(more).cloned().collect()
    }
}
