//! The names that renderers give to additive passes, each with where it is documented: lobes that add up to the picture, and
//! light groups, which are named after it.

use crate::names::{NamePattern, candidates};
use sspc_image::Role;

/// A lobe: one layer, or several that come to the same.
#[derive(Clone, Copy, Debug)]
pub struct Lobe {
    /// Names of the layer, lower-case.
    pub names: &'static [&'static str],
    /// Names of the layer that it is multiplied by before it is added.
    pub colour: &'static [&'static str],
    /// Names of layers that add up to it: where any of them is there, they may stand for it.
    pub parts: &'static [&'static str],
}

/// How a renderer names its lobes.
#[derive(Clone, Copy, Debug)]
pub struct Convention {
    /// The renderer.
    pub renderer: &'static str,
    /// The document that tells.
    pub source: &'static str,
    /// Its lobes.
    pub lobes: &'static [Lobe],
}

const fn lobe(names: &'static [&'static str]) -> Lobe {
    Lobe { names, colour: &[], parts: &[] }
}

const fn coloured(names: &'static [&'static str], colour: &'static [&'static str]) -> Lobe {
    Lobe { names, colour, parts: &[] }
}

const fn of_parts(names: &'static [&'static str], parts: &'static [&'static str]) -> Lobe {
    Lobe { names, colour: &[], parts }
}

const DIFFUSE_COLOUR: &[&str] = &["diffuse color", "diffcol"];
const GLOSSY_COLOUR: &[&str] = &["glossy color", "glosscol"];
const TRANSMISSION_COLOUR: &[&str] = &["transmission color", "transcol"];
const SUBSURFACE_COLOUR: &[&str] = &["subsurface color", "subsurfacecol"];

/// Combined = colour (direct + indirect) of each lobe + volume + emission + environment; the short names are those of
/// Blender before 5.0.
const CYCLES: &[Lobe] = &[
    coloured(&["diffuse direct", "diffdir"], DIFFUSE_COLOUR),
    coloured(&["diffuse indirect", "diffind"], DIFFUSE_COLOUR),
    coloured(&["glossy direct", "glossdir"], GLOSSY_COLOUR),
    coloured(&["glossy indirect", "glossind"], GLOSSY_COLOUR),
    coloured(&["transmission direct", "transdir"], TRANSMISSION_COLOUR),
    coloured(&["transmission indirect", "transind"], TRANSMISSION_COLOUR),
    coloured(&["subsurface direct", "subsurfacedir"], SUBSURFACE_COLOUR),
    coloured(&["subsurface indirect", "subsurfaceind"], SUBSURFACE_COLOUR),
    lobe(&["volume direct", "volumedir"]),
    lobe(&["volume indirect", "volumeind"]),
    lobe(&["emission", "emit"]),
    lobe(&["environment", "env"]),
];

const ARNOLD: &[Lobe] = &[
    of_parts(&["diffuse"], &["diffuse_direct", "diffuse_indirect"]),
    of_parts(&["specular"], &["specular_direct", "specular_indirect"]),
    of_parts(&["coat"], &["coat_direct", "coat_indirect"]),
    of_parts(&["sheen"], &["sheen_direct", "sheen_indirect"]),
    of_parts(&["transmission"], &["transmission_direct", "transmission_indirect"]),
    of_parts(&["sss"], &["sss_direct", "sss_indirect"]),
    of_parts(&["volume"], &["volume_direct", "volume_indirect"]),
    of_parts(&["emission"], &["emission_direct", "emission_indirect"]),
    lobe(&["lightsources"]),
    lobe(&["background"]),
];

const RENDERMAN: &[Lobe] = &[
    of_parts(&["diffuse"], &["directdiffuse", "indirectdiffuse", "directdiffuselobe", "indirectdiffuselobe"]),
    of_parts(
        &["specular"],
        &[
            "directspecular",
            "indirectspecular",
            "directspecularprimarylobe",
            "indirectspecularprimarylobe",
            "directspecularroughlobe",
            "indirectspecularroughlobe",
            "directspecularclearcoatlobe",
            "indirectspecularclearcoatlobe",
            "directspeculariridescencelobe",
            "indirectspeculariridescencelobe",
            "directspecularfuzzlobe",
            "indirectspecularfuzzlobe",
            "directspecularglasslobe",
            "indirectspecularglasslobe",
        ],
    ),
    lobe(&["subsurface", "subsurfacelobe"]),
    of_parts(&["transmissive"], &["transmissivesinglescatterlobe", "transmissiveglasslobe"]),
    lobe(&["emissive"]),
];

const KARMA: &[Lobe] = &[
    of_parts(&["combineddiffuse"], &["directdiffuse", "indirectdiffuse"]),
    of_parts(&["combinedglossyreflection"], &["directglossyreflection", "indirectglossyreflection"]),
    lobe(&["glossytransmission"]),
    lobe(&["coat"]),
    lobe(&["sss"]),
    of_parts(&["combinedvolume"], &["directvolume", "indirectvolume"]),
    of_parts(&["combinedemission"], &["directemission", "indirectemission"]),
    lobe(&["visiblelights"]),
];

const VRAY: &[Lobe] = &[
    lobe(&["lighting", "vraylighting"]),
    lobe(&["gi", "globalillumination", "global illumination", "vrayglobalillumination"]),
    lobe(&["specular", "vrayspecular"]),
    lobe(&["reflection", "reflect", "vrayreflection"]),
    lobe(&["refraction", "refract", "vrayrefraction"]),
    lobe(&["sss", "sss2", "subsurface scattering", "vraysss2"]),
    lobe(&["selfillumination", "selfillum", "self illumination", "vrayselfillumination"]),
    lobe(&["caustics", "vraycaustics"]),
    lobe(&["atmosphere", "atmospheric effects", "atmospheric_effects", "vrayatmosphere"]),
    lobe(&["background", "vraybackground"]),
];

/// All conventions, the surest first.
pub const CONVENTIONS: &[Convention] = &[
    Convention {
        renderer: "Blender Cycles",
        source: "Combining, docs.blender.org/manual/en/latest/render/layers/passes.html",
        lobes: CYCLES,
    },
    Convention {
        renderer: "Arnold",
        source: "Light Path Expression AOVs, help.autodesk.com/view/ARNOL",
        lobes: ARNOLD,
    },
    Convention { renderer: "RenderMan", source: "Light Path Expressions, rmanwiki.pixar.com", lobes: RENDERMAN },
    Convention {
        renderer: "Houdini Karma",
        source: "Karma Standard Render Vars, www.sidefx.com/docs/houdini/nodes/lop/karmastandardrendervars.html",
        lobes: KARMA,
    },
    Convention { renderer: "V-Ray", source: "Back to Beauty, docs.chaos.com", lobes: VRAY },
];

/// Whether a layer (lower-case, last segment) is named as a light group: after a picture's name, as Cycles' `Combined_key`,
/// Arnold's `RGBA_key` and Karma's `C_key` are; not what a denoiser made of a picture.
pub fn is_light_group(name: &str) -> bool {
    let is_denoised = candidates(Role::Denoised).iter().any(|known| known.pattern.stem(name).is_some());
    let noisy = name.ends_with("_noisy");
    !is_denoised
        && !noisy
        && candidates(Role::Radiance).iter().any(|known| match known.pattern {
            NamePattern::Whole(picture) if !picture.is_empty() => {
                name.strip_prefix(picture).is_some_and(|rest| rest.len() > 1 && rest.starts_with(['_', '-', ' ', ':']))
            }
            _ => false,
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn light_groups_are_named_after_a_picture() {
        for name in ["combined_key", "rgba_default", "c_sun", "beauty-rim", "ci_lamp.1"] {
            assert!(is_light_group(name), "{name}");
        }
        for name in ["combined", "rgba_denoised", "combined_", "diffuse_key", "crypto_object", "beauty_noisy"] {
            assert!(!is_light_group(name), "{name}");
        }
    }

    #[test]
    fn every_name_is_lower_case_once_and_has_a_source() {
        for Convention { renderer, source, lobes } in CONVENTIONS {
            assert!(!source.is_empty(), "{renderer}");
            let mut names: Vec<&str> =
                lobes.iter().flat_map(|lobe| lobe.names.iter().chain(lobe.parts)).copied().collect();
            let count = names.len();
            names.sort_unstable();
            names.dedup();
            assert_eq!(names.len(), count, "{renderer}");
            assert!(names.iter().all(|name| *name == name.to_lowercase()), "{renderer}");
        }
    }
}
