//! Channel order of the features that the network reads and g_c compares: its one owner.

/// y(3) ρ(3) v(1) n(3) z(3).
pub const FEATURE_CHANNELS: usize = 13;
/// First channel of the noisy radiance y.
pub const RADIANCE: usize = 0;
/// First channel of the albedo ρ.
pub const ALBEDO: usize = 3;
/// The visibility v.
pub const VISIBILITY: usize = 6;
/// First channel of the normal n.
pub const NORMAL: usize = 7;
/// First channel of the denoised radiance z.
pub const DENOISED: usize = 10;

/// Names of the channels, in order, as the model contract states them.
pub const CHANNEL_NAMES: [&str; FEATURE_CHANNELS] = [
    "radiance.R",
    "radiance.G",
    "radiance.B",
    "albedo.R",
    "albedo.G",
    "albedo.B",
    "visibility",
    "normal.X",
    "normal.Y",
    "normal.Z",
    "denoised.R",
    "denoised.G",
    "denoised.B",
];

/// Which optional features take part. One that is absent, or the same at every pixel, is all
/// zeros, its differences vanish, and the kernels skip it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct FeatureSet {
    /// ρ.
    pub albedo: bool,
    /// n.
    pub normal: bool,
    /// v.
    pub visibility: bool,
}

impl FeatureSet {
    /// All of them.
    pub const ALL: FeatureSet = FeatureSet { albedo: true, normal: true, visibility: true };
    /// None of them: y and z alone.
    pub const NONE: FeatureSet = FeatureSet { albedo: false, normal: false, visibility: false };

    /// Features of this one that the other has not.
    pub fn without(self, other: FeatureSet) -> FeatureSet {
        FeatureSet {
            albedo: self.albedo && !other.albedo,
            normal: self.normal && !other.normal,
            visibility: self.visibility && !other.visibility,
        }
    }

    /// Features of either.
    pub fn union(self, other: FeatureSet) -> FeatureSet {
        FeatureSet {
            albedo: self.albedo || other.albedo,
            normal: self.normal || other.normal,
            visibility: self.visibility || other.visibility,
        }
    }
}

/// Radius of the largest window Ω_c that [`Windows`] can serve: 25 x 25 pixels.
pub const MAX_RADIUS: usize = 12;
