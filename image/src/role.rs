//! What a channel means to the method, and which samples an image was made from.

use std::fmt;

/// What a channel of a file means to the method.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Role {
    /// Noisy radiance y, 3 channels.
    Radiance,
    /// The denoiser's output z, 3 channels.
    Denoised,
    /// Albedo ρ, 3 channels.
    Albedo,
    /// Shading normal n, 3 channels.
    Normal,
    /// Visibility of the lights at the first hit v, 1 channel.
    Visibility,
    /// Motion of what is seen to the neighbouring frames of a shot: two channels to one of them, or four to both.
    Motion,
    /// World position of what is seen, 3 channels; with a camera it tells motion.
    Position,
    /// Horizontal differences of y, y(x + 1) - y(x), as gradient-domain renderers estimate them, 3 channels.
    Dx,
    /// Vertical differences of y, that of the row below less that of this one, 3 channels.
    Dy,
}

/// Which samples an image was made from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Buffer {
    /// Half buffer a.
    A,
    /// Half buffer b.
    B,
    /// The full buffer (a + b) / 2.
    Full,
}

impl Role {
    /// All roles, in the order they are read.
    pub const ALL: [Role; 9] = [
        Role::Radiance,
        Role::Denoised,
        Role::Albedo,
        Role::Normal,
        Role::Visibility,
        Role::Motion,
        Role::Position,
        Role::Dx,
        Role::Dy,
    ];

    /// The optional features, which network and g_c read.
    pub const FEATURES: [Role; 3] = [Role::Albedo, Role::Normal, Role::Visibility];

    /// Differences of y, which training compares those of the corrected picture with.
    pub const DIFFERENCES: [Role; 2] = [Role::Dx, Role::Dy];

    /// The role with this [`Role::name`].
    pub fn named(name: &str) -> Option<Role> {
        Role::ALL.into_iter().find(|role| role.name() == name)
    }

    /// Channels of an image of this role, at most.
    pub fn channels(self) -> usize {
        match self {
            Role::Visibility => 1,
            Role::Motion => 4,
            Role::Radiance | Role::Denoised | Role::Albedo | Role::Normal | Role::Position | Role::Dx | Role::Dy => 3,
        }
    }

    /// Its name on command lines, in models and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Role::Radiance => "radiance",
            Role::Denoised => "denoised",
            Role::Albedo => "albedo",
            Role::Normal => "normal",
            Role::Visibility => "visibility",
            Role::Motion => "motion",
            Role::Position => "position",
            Role::Dx => "dx",
            Role::Dy => "dy",
        }
    }
}

impl Buffer {
    /// Its name on command lines and in reports.
    pub fn name(self) -> &'static str {
        match self {
            Buffer::A => "a",
            Buffer::B => "b",
            Buffer::Full => "full",
        }
    }
}

impl fmt::Display for Role {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Role::Radiance => "noisy colour",
            Role::Denoised => "denoised colour",
            Role::Albedo => "albedo",
            Role::Normal => "normal",
            Role::Visibility => "visibility",
            Role::Motion => "motion",
            Role::Position => "world position",
            Role::Dx => "horizontal differences",
            Role::Dy => "vertical differences",
        })
    }
}

impl fmt::Display for Buffer {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        out.write_str(match self {
            Buffer::A => "half a",
            Buffer::B => "half b",
            Buffer::Full => "the full buffer",
        })
    }
}
