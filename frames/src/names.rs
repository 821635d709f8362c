//! The names that renderers give to the roles, compared without regard to case, each with where it is documented.

use sspc_image::Role;
use std::fmt;
use std::ops::RangeInclusive;

/// How a layer's last segment is recognised. Names are lower-case.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NamePattern {
    /// It is this.
    Whole(&'static str),
    /// It starts with this.
    Starts(&'static str),
    /// It ends with this; what is before is the name of the layer that it was made of.
    Suffix(&'static str),
}

use NamePattern::{Starts, Suffix, Whole};

/// A name and who says so.
#[derive(Clone, Copy, Debug)]
pub struct Known {
    /// The name.
    pub pattern: NamePattern,
    /// Renderers that write it, and the document that tells.
    pub source: &'static str,
}

const fn known(pattern: NamePattern, source: &'static str) -> Known {
    Known { pattern, source }
}

const ARNOLD: &str =
    "Arnold, Denoising, help.autodesk.com/cloudhelp/ENU/AR-Core/files/arnold_user_guide_ac_denoising_html.html";
const ARNOLD_AOVS: &str = "Arnold, AOVs, help.autodesk.com/view/ARNOL";
const ARNOLD_POSITION: &str = "Arnold, Built-in AOVs, help.autodesk.com/cloudhelp/ENU/AR-DevGuide/files/plugins/shaders/arnold_dev_guide_shading_lighting_av_aovs_html.html";
const COMMON: &str = "what artists and pipelines write";
const CORONA: &str = "Corona, Render Elements, docs.chaos.com/display/CRMAX/Render+Elements";
const CYCLES: &str = "Blender Cycles, Passes, docs.blender.org/manual/en/latest/render/layers/passes.html";
const DELIGHT: &str = "3Delight, AOV Selector, documentation.3delightcloud.com/display/3DFM9/AOV+Selector";
const GUERILLA: &str = "Guerilla Render, AOV, guerillarender.com/doc/2.2/User%20Guide_Rendering_AOV.html";
const GRADIENTS: &str =
    "gradient-domain path tracing, Lehtinen et al. 2013, Kettunen et al. 2015 (doi 10.1145/2766997)";
const KARMA: &str = "Houdini Karma, AOVs, www.sidefx.com/docs/houdini/solaris/support/aovs.html";
const LUXCORE: &str = "LuxCoreRender, film output types of its SDK";
const MOONRAY: &str = "MoonRay, render outputs, docs.openmoonray.org";
const MITSUBA: &str = "Mitsuba 3, aov integrator, mitsuba.readthedocs.io";
const NOICE: &str = "Arnold noice, Required Input Layers, docs.arnoldrenderer.com";
const OCTANE: &str = "Octane, Open Image Denoise and Render Passes, docs.otoy.com/standaloneSE/OpenImageDenoise.html";
const PAPER: &str = "the paper's published data";
const PBRT: &str = "pbrt-v4, GBufferFilm, pbrt.org/fileformat-v4";
const REDSHIFT: &str = "Redshift, Integrated AOVs, docs.redshift3d.com/display/RSDOCS/Integrated+AOVs";
const RENDERMAN: &str = "RenderMan, Denoising, rmanwiki.pixar.com/display/REN24/Denoising";
const RENDERMAN_AOVS: &str = "RenderMan, Arbitrary Output Variables, rmanwiki.pixar.com";
const VRAY: &str = "V-Ray, Denoiser render element, docs.chaosgroup.com/pages/viewpage.action?pageId=43549161";
const VRAY_NAMES: &str = "V-Ray, default channel names, docs.chaos.com/pages/viewpage.action?pageId=29564243";

/// Colour that its writer calls noisy; where it is, the layer without that word is the denoised one.
const NOISY: &[Known] =
    &[known(Whole("noisy image"), CYCLES), known(Whole("noisy"), LUXCORE), known(Suffix("_noisy"), COMMON)];

/// The picture of a frame or of a view layer, from the surest to the vaguest. The empty name is the root layer.
const COLOUR: &[Known] = &[
    known(Whole(""), "every renderer"),
    known(Whole("combined"), CYCLES),
    known(Whole("beauty"), GUERILLA),
    known(Whole("rgba"), ARNOLD),
    known(Whole("rgb"), COMMON),
    known(Whole("c"), KARMA),
    known(Whole("ci"), RENDERMAN),
    known(Whole("primary"), DELIGHT),
    known(Whole("default"), COMMON),
    known(Whole("color"), COMMON),
    known(Whole("colour"), COMMON),
    known(Whole("radiance"), COMMON),
    known(Whole("finalimage"), "Unreal, Movie Render Queue, dev.epicgames.com"),
    known(Whole("randimg"), PAPER),
];

const DENOISED: &[Known] = &[
    known(Suffix("_denoised"), ARNOLD),
    known(Suffix("_denoise"), ARNOLD),
    known(Suffix("_filtered"), RENDERMAN),
    known(Suffix(" denoised"), COMMON),
    known(Suffix("-denoised"), COMMON),
    known(Suffix("denoised"), COMMON),
    known(Whole("denoised"), REDSHIFT),
    known(Whole("denoisedbeauty"), OCTANE),
    known(Whole("denoised beauty"), OCTANE),
    known(Whole("denoised_beauty"), OCTANE),
    known(Whole("vraydenoiser"), VRAY),
    known(Whole("denoiser"), VRAY),
    known(Whole("effectsresult"), VRAY),
    known(Starts("denoimg"), PAPER),
];

const ALBEDO: &[Known] = &[
    known(Whole("denoising albedo"), CYCLES),
    known(Whole("albedo"), MITSUBA),
    known(Whole("denoise_albedo_noice"), NOICE),
    known(Whole("denoise_albedo"), NOICE),
    known(Whole("denoisealbedo"), OCTANE),
    known(Whole("denoise albedo"), OCTANE),
    known(Whole("diffuse_albedo"), NOICE),
    known(Whole("diffcol"), CYCLES),
    known(Whole("diffuse color"), CYCLES),
    known(Whole("visiblediffuse"), COMMON),
    known(Whole("diffusefilter"), REDSHIFT),
    known(Whole("diffuse filter"), REDSHIFT),
    known(Whole("diffuse_filter"), VRAY_NAMES),
    known(Whole("vraydiffusefilter"), VRAY),
    known(Whole("basecolor"), KARMA),
    known(Whole("base_color"), KARMA),
    known(Whole("cshading_albedo"), CORONA),
    known(Whole("cshading_sourcecolor"), CORONA),
];

const NORMAL: &[Known] = &[
    known(Whole("denoising normal"), CYCLES),
    known(Whole("normal"), GUERILLA),
    known(Whole("ns"), PBRT),
    known(Whole("n"), ARNOLD),
    known(Whole("nn"), MITSUBA),
    known(Whole("n_noice"), NOICE),
    known(Whole("sh_normal"), MITSUBA),
    known(Whole("avg_shading_normal"), LUXCORE),
    known(Whole("shading_normal"), LUXCORE),
    known(Whole("denoisenormal"), OCTANE),
    known(Whole("denoise normal"), OCTANE),
    known(Whole("denoise_normal"), OCTANE),
    known(Whole("normals"), VRAY_NAMES),
    known(Whole("vraynormals"), VRAY),
    known(Whole("visiblenormals"), COMMON),
    known(Whole("optixnormals"), COMMON),
    known(Whole("hitn"), KARMA),
    known(Whole("worldnormal"), "Unreal, Movie Render Queue, dev.epicgames.com"),
    known(Whole("cgeometry_normalsshading"), CORONA),
    known(Whole("bumpnormals"), REDSHIFT),
    known(Whole("bump_normals"), VRAY_NAMES),
];

const VISIBILITY: &[Known] = &[known(Whole("visibility"), PAPER)];

/// What each of them means is found out by looking (`sspc-shots`).
const MOTION: &[Known] = &[
    known(Whole("vector"), CYCLES),
    known(Whole("motionvector"), ARNOLD_AOVS),
    known(Whole("motionvectors"), REDSHIFT),
    known(Whole("motion vectors"), KARMA),
    known(Whole("motion vector"), OCTANE),
    known(Whole("motion_vector"), COMMON),
    known(Whole("motion_vectors"), COMMON),
    known(Whole("motionvec"), MOONRAY),
    known(Whole("backward"), RENDERMAN),
    known(Whole("forward"), RENDERMAN),
    known(Whole("motionback"), RENDERMAN),
    known(Whole("motionfore"), RENDERMAN),
    known(Whole("velocity"), VRAY_NAMES),
    known(Whole("vrayvelocity"), VRAY),
    known(Whole("cgeometry_velocity"), CORONA),
    known(Whole("motion"), "Nuke, VectorGenerator, learn.foundry.com/nuke"),
];

/// Position in the world, which a camera's matrix is tried on (`sspc-shots`): in camera space it is refused there.
const POSITION: &[Known] = &[
    known(Whole("p"), ARNOLD_POSITION),
    known(Whole("position"), CYCLES),
    known(Whole("__pworld"), RENDERMAN_AOVS),
    known(Whole("pworld"), COMMON),
    known(Whole("hitp"), KARMA),
    known(Whole("worldposition"), COMMON),
    known(Whole("world_position"), COMMON),
    known(Whole("world position"), REDSHIFT),
    known(Whole("worldpos"), MOONRAY),
    known(Whole("cgeometry_worldposition"), CORONA),
];

/// Attributes that hold the matrix from the world to the picture. `worldToNDC` is OpenEXR's (Standard Attributes,
/// openexr.com/en/latest/StandardAttributes.html): (0, 0) is the upper left and (1, 1) the lower right corner of the display
/// window. Mantra's is -1..1 (ynput/ayon-houdini, issue 76), as was that of programs that write by OpenImageIO before its
/// pull request 2609; `worldToScreen` and RenderMan's `NP` are the other names that OpenUSD knows for it.
pub const CAMERAS: [&str; 4] = ["worldToNDC", "worldToScreen", "worldtoscreen", "NP"];

/// Differences to the right-hand neighbour.
const DX: &[Known] = &[
    known(Whole("dx"), GRADIENTS),
    known(Whole("grad_x"), COMMON),
    known(Whole("gradx"), COMMON),
    known(Whole("gradient_x"), COMMON),
    known(Whole("gradientx"), COMMON),
];

/// Differences to the neighbour below.
const DY: &[Known] = &[
    known(Whole("dy"), GRADIENTS),
    known(Whole("grad_y"), COMMON),
    known(Whole("grady"), COMMON),
    known(Whole("gradient_y"), COMMON),
    known(Whole("gradienty"), COMMON),
];

/// Layers of which each holds the motion to one neighbour, and both together to both.
const MOTION_PAIRS: &[(&str, &str)] = &[("backward", "forward"), ("motionback", "motionfore")];

/// The names a role goes by, first hit wins; of noisy colour, [`noisy`] ones come before.
pub fn candidates(role: Role) -> &'static [Known] {
    match role {
        Role::Radiance => COLOUR,
        Role::Denoised => DENOISED,
        Role::Albedo => ALBEDO,
        Role::Normal => NORMAL,
        Role::Visibility => VISIBILITY,
        Role::Motion => MOTION,
        Role::Position => POSITION,
        Role::Dx => DX,
        Role::Dy => DY,
    }
}

/// Names of colour that says it is noisy.
pub fn noisy() -> &'static [Known] {
    NOISY
}

/// Whether a name (lower-case, last segment) is that of a whole picture, not of one light or component of it.
pub fn is_colour(name: &str) -> bool {
    COLOUR.iter().any(|known| known.pattern.stem(name) == Some(""))
}

/// What a name that says it is noisy is the noisy version of: `beauty` of `beauty_noisy`, nothing of `noisy`. `None` for
/// other names.
pub fn noisy_stem(name: &str) -> Option<&str> {
    NOISY.iter().find_map(|known| known.pattern.stem(name)).filter(|stem| stem.is_empty() || is_colour(stem))
}

/// The component endings of a role, best first; each is a full set.
pub fn component_sets(role: Role) -> &'static [&'static [&'static str]] {
    match role {
        Role::Visibility => &[&["y"], &["v"], &["r"], &["x"], &["red"], &["l"]],
        // Of three components the third is depth, or nothing.
        Role::Motion => &[&["x", "y", "z", "w"], &["x", "y"], &["u", "v"], &["r", "g"], &["red", "green"]],
        _ => &[&["r", "g", "b"], &["red", "green", "blue"], &["x", "y", "z"]],
    }
}

/// Endings of a grey picture's only component.
pub const GREY: &[&str] = &["y", "l"];

/// Channels that a role may have: 3, 1 for visibility, 2 to 4 for motion.
pub fn component_counts(role: Role) -> RangeInclusive<usize> {
    match role {
        Role::Visibility => 1..=1,
        Role::Motion => 2..=4,
        _ => 3..=3,
    }
}

/// The layer beside one that holds the motion to one neighbour, which holds that to the other.
pub fn motion_partner(name: &str) -> Option<&'static str> {
    MOTION_PAIRS.iter().find_map(|(back, fore)| match name {
        _ if name == *back => Some(*fore),
        _ if name == *fore => Some(*back),
        _ => None,
    })
}

impl NamePattern {
    /// What of a lower-case name is left of this: nothing of a whole name, the name before a suffix. `None` for names that
    /// it does not match.
    pub fn stem(self, name: &str) -> Option<&str> {
        match self {
            Whole(whole) => (name == whole).then_some(""),
            Starts(start) => name.starts_with(start).then_some(""),
            Suffix(end) => name.strip_suffix(end).filter(|stem| !stem.is_empty()),
        }
    }
}

impl fmt::Display for NamePattern {
    fn fmt(&self, out: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Whole("") => out.write_str("R,G,B"),
            Whole(name) => out.write_str(name),
            Starts(start) => write!(out, "{start}*"),
            Suffix(end) => write!(out, "*{end}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_and_what_they_are_made_of() {
        assert_eq!(Whole("combined").stem("combined"), Some(""));
        assert_eq!(Whole("combined").stem("recombined"), None);
        assert_eq!(Suffix("_denoised").stem("rgba_key_denoised"), Some("rgba_key"));
        assert_eq!(Suffix("_denoised").stem("_denoised"), None);
        assert_eq!((noisy_stem("noisy image"), noisy_stem("beauty_noisy")), (Some(""), Some("beauty")));
        assert_eq!((noisy_stem("diffuse_noisy"), noisy_stem("beauty")), (None, None));
        assert!(is_colour("") && is_colour("rgba") && !is_colour("rgba_key"));
    }

    #[test]
    fn every_name_is_lower_case_and_has_a_source() {
        let all = Role::ALL.iter().flat_map(|role| candidates(*role)).chain(noisy());
        for Known { pattern, source } in all {
            let (Whole(name) | Starts(name) | Suffix(name)) = pattern;
            assert_eq!(*name, name.to_lowercase());
            assert!(!source.is_empty(), "{pattern}");
        }
    }
}
