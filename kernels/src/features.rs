//! Channel order of the features that the network reads and g_c compares: its one owner.

use sspc_image::Role;

/// Roles of the feature channels, in their order: y(3) ρ(3) v(1) n(3) z(3).
pub const ORDER: [Role; 5] = [Role::Radiance, Role::Albedo, Role::Visibility, Role::Normal, Role::Denoised];
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
/// Channels in all.
pub const FEATURE_CHANNELS: usize = 13;

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

    /// The features of which `takes_part` is true.
    pub fn of(takes_part: impl Fn(Role) -> bool) -> FeatureSet {
        let [albedo, normal, visibility] = Role::FEATURES.map(takes_part);
        FeatureSet { albedo, normal, visibility }
    }

    /// Whether this feature takes part; y and z always do.
    pub fn has(self, role: Role) -> bool {
        match role {
            Role::Albedo => self.albedo,
            Role::Normal => self.normal,
            Role::Visibility => self.visibility,
            Role::Radiance | Role::Denoised => true,
            // They move pictures, or judge them, and are not read.
            Role::Motion | Role::Position | Role::Dx | Role::Dy => false,
        }
    }

    /// The features that take part.
    pub fn iter(self) -> impl Iterator<Item = Role> {
        Role::FEATURES.into_iter().filter(move |&role| self.has(role))
    }

    /// Their names, with `separator` between them.
    pub fn names(self, separator: &str) -> String {
        self.iter().map(Role::name).collect::<Vec<_>>().join(separator)
    }

    /// Features of this one that the other has not.
    pub fn without(self, other: FeatureSet) -> FeatureSet {
        FeatureSet::of(|role| self.has(role) && !other.has(role))
    }

    /// Features of either.
    pub fn union(self, other: FeatureSet) -> FeatureSet {
        FeatureSet::of(|role| self.has(role) || other.has(role))
    }

    /// Features of both.
    pub fn intersection(self, other: FeatureSet) -> FeatureSet {
        FeatureSet::of(|role| self.has(role) && other.has(role))
    }
}

/// Radius of the largest window Ω_c that [`Windows`](crate::windows::Windows) can serve: 25 x 25 pixels.
pub const MAX_RADIUS: usize = 12;

#[cfg(test)]
mod tests {
    use super::*;

    /// Fails when the constants, the names and the order disagree.
    #[test]
    fn channels_follow_the_order_of_the_roles() {
        let firsts = [RADIANCE, ALBEDO, VISIBILITY, NORMAL, DENOISED];
        let mut next = 0;
        for (role, first) in ORDER.into_iter().zip(firsts) {
            assert_eq!(first, next, "{role}");
            next += role.channels();
            for name in &CHANNEL_NAMES[first..next] {
                assert_eq!(name.split('.').next(), Some(role.name()), "{role}");
            }
        }
        assert_eq!(next, FEATURE_CHANNELS);
    }

    #[test]
    fn sets_are_combined_feature_by_feature() {
        let set = FeatureSet::of(|role| role != Role::Normal);
        assert_eq!((set.names(", ").as_str(), set.has(Role::Denoised)), ("albedo, visibility", true));
        let normal = FeatureSet { normal: true, ..FeatureSet::NONE };
        assert_eq!((set.union(normal), set.intersection(normal)), (FeatureSet::ALL, FeatureSet::NONE));
        assert_eq!(FeatureSet::ALL.without(set), normal);
    }
}
