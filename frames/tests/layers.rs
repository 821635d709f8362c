//! Which layers belong together, by the names that renderers and people write: each case is the smallest pair that was
//! once read wrongly, or a relative of it.

use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer};
use exr::meta::attribute::Text;
use exr::meta::header::LayerAttributes;
use exr::prelude::WritableImage;
use sspc_frames::error::{Error, ErrorKind};
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides};
use sspc_image::{Buffer, Role};
use std::path::{Path, PathBuf};

const SIZE: (usize, usize) = (6, 4);

/// One part with R, G, B (or the endings after the last slash) in each layer.
fn write(path: &Path, layers: &[&str], views: &[&str]) -> PathBuf {
    let mut list = Vec::new();
    for layer in layers {
        let (name, endings) = layer.rsplit_once('/').unwrap_or((layer, "RGB"));
        for ending in endings.chars() {
            let name = if name.is_empty() { ending.to_string() } else { format!("{name}.{ending}") };
            let samples = FlatSamples::F32(vec![0.5; SIZE.0 * SIZE.1]);
            list.push(AnyChannel {
                name: Text::from_slice_unchecked(name.as_bytes()),
                ..AnyChannel::new("x", samples)
            });
        }
    }
    let multi_view_names = (!views.is_empty()).then(|| views.iter().map(|&view| Text::from(view)).collect());
    let attributes = LayerAttributes { multi_view_names, ..LayerAttributes::default() };
    let layer = Layer::new(SIZE, attributes, Encoding::FAST_LOSSLESS, AnyChannels::sort(list.into_iter().collect()));
    Image::from_layer(layer).write().to_file(path).expect("a test file");
    path.into()
}

fn pair(folder: &Path, layers: &[&str], views: &[&str]) -> FrameFiles {
    FrameFiles::halves(write(&folder.join("a.exr"), layers, views), write(&folder.join("b.exr"), layers, views))
}

fn open(files: &FrameFiles, roles: &[&str]) -> Result<OpenFrame, Error> {
    OpenFrame::open(files, &RoleOverrides::parse(roles).expect("overrides"))
}

/// The layer that fills a role.
fn layer(frame: &OpenFrame, role: Role, buffer: Buffer) -> String {
    let sources = frame.sources();
    let Some(source) = sources.iter().find(|source| (source.role, source.buffer) == (role, buffer)) else {
        return "-".into();
    };
    source.channels[0].rsplit_once('.').map_or("", |(layer, _)| layer).to_string()
}

/// Layers of a file; noisy colour, denoised colour, albedo, normal; where the picture goes.
type Case = (&'static [&'static str], [&'static str; 4], &'static str);

const CASES: &[Case] = &[
    // Renderers, unasked.
    (&["", "RGBA_denoise", "denoise_albedo", "N/XYZ", "diffuse"], ["", "RGBA_denoise", "denoise_albedo", "N"], ""),
    (
        &["V.Combined", "V.DenoisedBeauty", "V.DenoiseAlbedo", "V.DenoiseNormal/XYZ"],
        ["V.Combined", "V.DenoisedBeauty", "V.DenoiseAlbedo", "V.DenoiseNormal"],
        "V.Combined",
    ),
    (
        &["V.Combined", "V.NOISY", "V.ALBEDO", "V.AVG_SHADING_NORMAL/XYZ"],
        ["V.NOISY", "V.Combined", "V.ALBEDO", "V.AVG_SHADING_NORMAL"],
        "V.Combined",
    ),
    (&["", "effectsResult", "diffuseFilter", "normals/XYZ"], ["", "effectsResult", "diffuseFilter", "normals"], ""),
    (&["", "DiffuseFilter", "BumpNormals", "Denoised"], ["", "Denoised", "DiffuseFilter", "BumpNormals"], ""),
    (
        &["beauty", "basecolor", "hitN/XYZ", "beauty_denoised"],
        ["beauty", "beauty_denoised", "basecolor", "hitN"],
        "beauty",
    ),
    (&["Ci/rgb", "Ci_filtered/rgb", "albedo/rgb", "normal/rgb"], ["Ci", "Ci_filtered", "albedo", "normal"], "Ci"),
    (
        &["", "RGBA_key", "RGBA_fill", "RGBA_denoised", "RGBA_key_denoised", "albedo", "N/XYZ"],
        ["", "RGBA_denoised", "albedo", "N"],
        "",
    ),
    (
        &["", ".effectsResult", ".normals/XYZ", ".diffuseFilter"],
        ["", ".effectsResult", ".diffuseFilter", ".normals"],
        "",
    ),
    (
        &["", "effectsResult", "diffuseFilter", "rawDiffuseFilter", "normals/XYZ", "bumpNormals/XYZ", "noiseLevel"],
        ["", "effectsResult", "diffuseFilter", "normals"],
        "",
    ),
    (&["", "DiffuseFilter", "N/XYZ", "BumpNormals", "/Z", "Denoised"], ["", "Denoised", "DiffuseFilter", "N"], ""),
    (&["", "Albedo", "Ns/XYZ", "N/XYZ", "P/XYZ", "Variance", "denoised"], ["", "denoised", "Albedo", "Ns"], ""),
    (&["", "albedo", "nn/XYZ", "dd/Y", "denoised"], ["", "denoised", "albedo", "nn"], ""),
    (
        &["/rgb", "albedo/rgb", "normal/rgb", "albedo_var/rgb", "normal_var/rgb", "mse/rgb", "denoised/rgb"],
        ["", "denoised", "albedo", "normal"],
        "",
    ),
    (&["C", "albedo", "N/XYZ", "C_denoised"], ["C", "C_denoised", "albedo", "N"], "C"),
    (
        &["L 100%.Combined", "L 100%.Noisy Image", "L 100%.Denoising Albedo", "L 100%.Denoising Normal/XYZ"],
        ["L 100%.Noisy Image", "L 100%.Combined", "L 100%.Denoising Albedo", "L 100%.Denoising Normal"],
        "L 100%.Combined",
    ),
    // What belongs to another layer is not taken.
    (
        &["BG.Noisy Image", "BG.Combined", "FG.Noisy Image", "FG.Combined", "FG.Denoising Albedo"],
        ["BG.Noisy Image", "BG.Combined", "-", "-"],
        "BG.Combined",
    ),
    (
        &["Composite.Combined", "V.Combined", "V.Noisy Image", "V.Denoising Albedo"],
        ["V.Noisy Image", "V.Combined", "V.Denoising Albedo", "-"],
        "V.Combined",
    ),
    (&["", "RGBA_ambient_denoised", "RGBA_denoised"], ["", "RGBA_denoised", "-", "-"], ""),
    (&["", "C_key", "C_key_denoised", "C_denoised"], ["", "C_denoised", "-", "-"], ""),
    (&["", "diffuse_noisy", "denoised"], ["", "denoised", "-", "-"], ""),
    // The layer without the word noisy is the denoised one.
    (&["beauty_noisy", "beauty", "albedo"], ["beauty_noisy", "beauty", "albedo", "-"], "beauty"),
    (&["", "noisy", "albedo"], ["noisy", "", "albedo", "-"], ""),
    // Letters at the end of names are no marks of halves between two files.
    (&["ShotA.Combined", "ShotA.Noisy Image"], ["ShotA.Noisy Image", "ShotA.Combined", "-", "-"], "ShotA.Combined"),
    (&["set_b.Combined", "set_b.Noisy Image"], ["set_b.Noisy Image", "set_b.Combined", "-", "-"], "set_b.Combined"),
    // UTF-8, dots, nested names.
    (
        &["视图层.Combined", "视图层.Noisy Image"],
        ["视图层.Noisy Image", "视图层.Combined", "-", "-"],
        "视图层.Combined",
    ),
    (
        &["v1.2 [BG].Combined", "v1.2 [BG].Noisy Image"],
        ["v1.2 [BG].Noisy Image", "v1.2 [BG].Combined", "-", "-"],
        "v1.2 [BG].Combined",
    ),
    (&["beauty", "beauty.denoised", "Albedo"], ["beauty", "beauty.denoised", "Albedo", "-"], "beauty"),
    // Grey stays grey.
    (&["/Y", "denoised/Y"], ["", "denoised", "-", "-"], ""),
];

#[test]
fn roles_belong_together() {
    let folder = tempfile::tempdir().expect("folder");
    for (layers, expected, place) in CASES {
        let frame = open(&pair(folder.path(), layers, &[]), &[]).unwrap_or_else(|error| panic!("{layers:?}: {error}"));
        let roles = [Role::Radiance, Role::Denoised, Role::Albedo, Role::Normal];
        for buffer in [Buffer::A, Buffer::B] {
            assert_eq!(roles.map(|role| layer(&frame, role, buffer)), *expected, "{layers:?} {buffer}");
        }
        let goes = frame.output().expect("an output").channels().remove(0);
        let goes = goes.split(',').next().and_then(|name| name.rsplit_once('.')).map_or("", |(layer, _)| layer);
        assert_eq!(goes, *place, "{layers:?}");
    }
}

#[test]
fn what_is_not_taken_is_said() {
    let folder = tempfile::tempdir().expect("folder");
    let layers = ["BG.Noisy Image", "BG.Combined", "FG.Noisy Image", "FG.Combined", "FG.Denoising Albedo"];
    let frame = open(&pair(folder.path(), &layers, &[]), &[]).expect("a frame");
    let notes = frame.notes().join("\n");
    assert!(notes.contains("passed over FG.Noisy Image"), "{notes}");
    assert!(notes.contains("albedo: FG.Denoising Albedo belongs to another layer"), "{notes}");
}

#[test]
fn a_light_is_replaced_itself_and_takes_no_other_layers_denoised_colour() {
    let folder = tempfile::tempdir().expect("folder");
    let files = pair(folder.path(), &["", "RGBA_key", "RGBA_key_denoised", "RGBA_denoised", "albedo"], &[]);
    let frame = open(&files, &["radiance=RGBA_key"]).expect("a frame");
    assert_eq!(layer(&frame, Role::Denoised, Buffer::B), "RGBA_key_denoised");
    assert_eq!(layer(&frame, Role::Albedo, Buffer::A), "albedo");
    assert_eq!(frame.output().expect("an output").channels(), ["RGBA_key.R,RGBA_key.G,RGBA_key.B"]);

    let files = pair(folder.path(), &["", "RGBA_key", "denoised"], &[]);
    let Err(error) = open(&files, &["radiance=RGBA_key"]) else { panic!("the picture's denoised colour for a light") };
    assert_eq!(error.kind(), ErrorKind::Input);
    assert!(error.to_string().contains("--role 'denoised=denoised'"), "{error}");
}

#[test]
fn both_files_give_the_same_path() {
    let folder = tempfile::tempdir().expect("folder");
    let a = write(&folder.path().join("a.exr"), &["beauty", "denoised", "albedo"], &[]);
    let b = write(&folder.path().join("b.exr"), &["", "denoised", "albedo"], &[]);
    let Err(error) = open(&FrameFiles::halves(a, b), &[]) else { panic!("two layers") };
    assert!(error.to_string().contains("beauty.R,beauty.G,beauty.B, as in half a"), "{error}");
}

#[test]
fn views_are_named_and_each_has_its_own_roles() {
    let folder = tempfile::tempdir().expect("folder");
    let layers = [
        "L.Noisy Image.left",
        "L.Combined.left",
        "L.Noisy Image.right",
        "L.Combined.right",
        "L.Denoising Albedo.right",
    ];
    let files = pair(folder.path(), &layers, &["left", "right"]);
    let left = open(&files, &[]).expect("the first view");
    assert_eq!(
        (layer(&left, Role::Radiance, Buffer::A), layer(&left, Role::Albedo, Buffer::A)),
        ("L.Noisy Image.left".into(), "-".into())
    );
    assert!(left.notes().iter().any(|note| note.contains("view left is corrected, right stays")), "{:?}", left.notes());
    let right = OpenFrame::open(&files, &RoleOverrides::none().of_view(Some("right".into()))).expect("the other view");
    assert_eq!(layer(&right, Role::Albedo, Buffer::B), "L.Denoising Albedo.right");
    let both = left.output().expect("left").and(right.output().expect("right")).expect("both");
    assert_eq!(both.channels().len(), 2);
    assert!(both.clone().and(right.output().expect("right")).is_err(), "one channel twice");
    let missing = OpenFrame::open(&files, &RoleOverrides::none().of_view(Some("up".into())));
    assert!(missing.is_err_and(|error| {
        error.to_string().contains("found the views left, right") && error.advice().contains("--view")
    }));
}

#[test]
fn some_of_r_g_b_at_the_root_are_no_place_for_a_picture() {
    let folder = tempfile::tempdir().expect("folder");
    let file = write(&folder.path().join("both.exr"), &["/G", "even", "odd", "denoised_even", "denoised_odd"], &[]);
    let frame = open(&FrameFiles::both_in_one(file), &[]).expect("a frame");
    let error = frame.output().expect_err("found before any work");
    assert_eq!(error.kind(), ErrorKind::Input);
    assert!(error.to_string().contains("found G alone"), "{error}");
}
