//! Which channel fills which role, for the names that renderers write.

use sspc_frames::error::Error;
use sspc_frames::files::{DenoisedFile, MoreDenoised};
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides, read_picture, read_reference};
use sspc_image::{Buffer, Role};
use sspc_testkit::exr_parts::{H, HALF, Part, W, value, write_file, write_halves, write_parts};
use sspc_testkit::frames::{ReadFrame, read_frame};
use std::path::Path;

fn read(files: &FrameFiles, overrides: &[&str]) -> Result<ReadFrame, Error> {
    read_frame(files, &RoleOverrides::parse(overrides).expect("overrides"))
}

fn channels(frame: &ReadFrame, role: Role, buffer: Buffer) -> Option<String> {
    let source = frame.sources.iter().find(|s| (s.role, s.buffer) == (role, buffer));
    source.map(|source| source.channels.join(","))
}

fn names(list: &str) -> Vec<&str> {
    list.split(' ').map(|name| name.trim()).collect()
}

/// Each line: a renderer's way to name noisy colour, denoised colour, albedo, normal and visibility ('-' = none),
/// with spaces inside names written as '+'.
const RENDERERS: &[[&str; 5]] = &[
    [
        "R G B",
        "denoised.R denoised.G denoised.B",
        "albedo.R albedo.G albedo.B",
        "normal.X normal.Y normal.Z",
        "visibility.Y",
    ],
    [
        "r g b",
        "x_denoised.r x_denoised.g x_denoised.b",
        "ALBEDO.red ALBEDO.green ALBEDO.blue",
        "Nx Ny Nz",
        "visibility",
    ],
    [
        "Beauty.R Beauty.G Beauty.B",
        "VRayDenoiser.R VRayDenoiser.G VRayDenoiser.B",
        "DiffCol.R DiffCol.G DiffCol.B",
        "normals.R normals.G normals.B",
        "-",
    ],
    [
        "View.Noisy+Image.R View.Noisy+Image.G View.Noisy+Image.B",
        "View.Combined.R View.Combined.G View.Combined.B",
        "View.Denoising+Albedo.R View.Denoising+Albedo.G View.Denoising+Albedo.B",
        "View.Denoising+Normal.X View.Denoising+Normal.Y View.Denoising+Normal.Z",
        "-",
    ],
    [
        "C.r C.g C.b",
        "effectsResult.R effectsResult.G effectsResult.B",
        "VisibleDiffuse.R VisibleDiffuse.G VisibleDiffuse.B",
        "OptixNormals.X OptixNormals.Y OptixNormals.Z",
        "Visibility.V",
    ],
    [
        "Ci.R Ci.G Ci.B",
        "Ci_filtered.R Ci_filtered.G Ci_filtered.B",
        "diffuse_albedo.R diffuse_albedo.G diffuse_albedo.B",
        "Nn.X Nn.Y Nn.Z",
        "-",
    ],
    [
        "R G B",
        ".denoImgFull.R .denoImgFull.G .denoImgFull.B",
        "denoise_albedo.R denoise_albedo.G denoise_albedo.B",
        "N_noice.X N_noice.Y N_noice.Z",
        "-",
    ],
];

#[test]
fn recognised_names_fill_the_roles() {
    let folder = tempfile::tempdir().expect("folder");
    for (i, renderer) in RENDERERS.iter().enumerate() {
        let listed: Vec<Vec<String>> = renderer
            .iter()
            .map(|list| names(list).iter().filter(|n| **n != "-").map(|name| name.replace('+', " ")).collect())
            .collect();
        let all: Vec<&str> = listed.iter().flatten().map(String::as_str).collect();
        let files = FrameFiles::halves(
            write_file(&folder.path().join(format!("{i}a.exr")), 1, &all),
            write_file(&folder.path().join(format!("{i}b.exr")), 2, &all),
        );
        let frame = read(&files, &[]).unwrap_or_else(|error| panic!("{renderer:?}: {error}"));
        for (role, expected) in Role::ALL.into_iter().zip(&listed) {
            let expected = (!expected.is_empty()).then(|| expected.join(","));
            assert_eq!(channels(&frame, role, Buffer::A), expected, "{renderer:?} {role}");
            assert_eq!(channels(&frame, role, Buffer::B), expected, "{renderer:?} {role}");
        }
        let red = &listed[0][0];
        assert_eq!(frame.b.radiance.at(0, H - 1, 2), value(2, red, (H - 1) * W + 2));
    }
}

#[test]
fn one_part_per_pass_is_read_like_one_file() {
    let folder = tempfile::tempdir().expect("folder");
    let parts = |named: bool| {
        let part = |name: &'static str, channels: &'static [&'static str]| Part { name, channels, ..Part::default() };
        match named {
            // Blender repeats the part's name in its channels, other writers do not.
            true => [
                part("L.Combined", &["L.Combined.R", "L.Combined.G", "L.Combined.B", "L.Combined.A"]),
                part("L.Noisy Image", &["L.Noisy Image.R", "L.Noisy Image.G", "L.Noisy Image.B"]),
                part("L.Depth", &["L.Depth.Z"]),
            ],
            false => [part("denoised", &["R", "G", "B"]), part("beauty", &["R", "G", "B", "A"]), part("depth", &["Z"])],
        }
    };
    for (named, radiance, denoised) in [
        (true, "L.Noisy Image.R,L.Noisy Image.G,L.Noisy Image.B", "L.Combined.R,L.Combined.G,L.Combined.B"),
        (false, "beauty.R,beauty.G,beauty.B", "denoised.R,denoised.G,denoised.B"),
    ] {
        let a = write_parts(&folder.path().join(format!("{named}a.exr")), 1, &parts(named));
        let b = write_parts(&folder.path().join(format!("{named}b.exr")), 2, &parts(named));
        let frame = read(&FrameFiles::halves(a, b), &[]).expect("frame");
        assert_eq!(channels(&frame, Role::Radiance, Buffer::A).as_deref(), Some(radiance));
        assert_eq!(channels(&frame, Role::Denoised, Buffer::B).as_deref(), Some(denoised));
    }
}

#[test]
fn a_first_part_of_any_name_is_the_colour_in_every_file() {
    let folder = tempfile::tempdir().expect("folder");
    let path = |name: &str| folder.path().join(name).with_extension("exr");
    // No renderer's names; dots and marks of halves in them mean nothing.
    for name in ["rgba_right", "customRgb", "Größe", "shot.v2", "ShotA", "set_b", "x"] {
        for more in [&["depth_left", "rgba_left"][..], &["rgba_left"], &[]] {
            let write = |file: &str, seed| {
                let part = |name, channels| Part { name, channels, ..Part::default() };
                let others = more.iter().map(|&other| match other {
                    "depth_left" => part(other, &["Z"]),
                    _ => part(other, &["R", "G", "B", "A"]),
                });
                let parts: Vec<Part> = [part(name, &["R", "G", "B", "A"])].into_iter().chain(others).collect();
                write_parts(&path(file), seed, &parts)
            };
            let files = ["a", "b", "za", "zb", "z"].iter().zip(1..).map(|(file, seed)| write(file, seed));
            let [a, b, za, zb, z] = files.collect::<Vec<_>>().try_into().expect("five files");
            let halves = FrameFiles::halves(&a, &b);
            let given = halves.clone().with_denoised(Some(za.clone()), Some(zb.clone()), Some(z.clone()));
            let told = ["-a", "-b", "-full"].iter().zip([&za, &zb, &z]);
            let told: Vec<String> = told.map(|(of, file)| format!("denoised{of}={}", file.display())).collect();
            let told: Vec<&str> = told.iter().map(String::as_str).collect();
            let denoised = |path: &Path| DenoisedFile { path: path.into(), layer: None };
            let again = MoreDenoised { halves: [denoised(&zb), denoised(&za)], full: Some(denoised(&z)) };
            // A file of one part has no part's name in its channels.
            let dot = if more.is_empty() { String::new() } else { format!("{name}.") };
            let colour = format!("{dot}R,{dot}G,{dot}B");
            for (way, files, overrides) in [
                ("a file", given.clone(), &[][..]),
                ("a role", halves, &told),
                ("a further one", given.with_more_denoised(vec![again]), &[]),
            ] {
                let case = format!("{name} before {more:?}, denoised by {way}");
                let frame = read(&files, overrides).unwrap_or_else(|error| panic!("{case}: {error}"));
                assert!(frame.sources.iter().all(|source| source.channels.join(",") == colour), "{case}");
                let red = |image: &sspc_image::Image| image.at(0, 2, 3);
                let full = frame.frame.denoised.as_ref().expect("a full buffer");
                let read = [&frame.a.radiance, &frame.b.radiance, &frame.a.denoised, &frame.b.denoised, full].map(red);
                assert_eq!(read, [1, 2, 3, 4, 5].map(|seed| value(seed, "R", 2 * W + 3)), "{case}");
                let output = OpenFrame::open(&files, &RoleOverrides::parse(overrides).expect("overrides"));
                let goes = output.and_then(|open| open.output()).expect("a possible output").channels();
                assert!(goes.len() == 1 && goes[0] == colour, "{case}: {goes:?}");
            }
            let shown = [read_picture(&z, None).expect("picture"), read_reference(&z, None).expect("reference").mean];
            assert!(shown.iter().all(|shown| shown.at(0, 2, 3) == value(5, "R", 2 * W + 3)), "{name} before {more:?}");
        }
    }
}

#[test]
fn both_halves_in_one_file_are_told_apart_by_their_marks() {
    let folder = tempfile::tempdir().expect("folder");
    let marked = names(
        "even.R even.G even.B odd.R odd.G odd.B denoised_even.R denoised_even.G denoised_even.B \
         denoised_odd.R denoised_odd.G denoised_odd.B albedoA.R albedoA.G albedoA.B albedoB.R albedoB.G albedoB.B \
         normal.X normal.Y normal.Z denoised.R denoised.G denoised.B",
    );
    let file = write_file(&folder.path().join("both.exr"), 1, &marked);
    let frame = read(&FrameFiles::both_in_one(&file), &[]).expect("frame");
    let of = |role, buffer| channels(&frame, role, buffer).expect("filled");
    assert_eq!(of(Role::Radiance, Buffer::A), "even.R,even.G,even.B");
    assert_eq!(of(Role::Radiance, Buffer::B), "odd.R,odd.G,odd.B");
    assert_eq!(of(Role::Denoised, Buffer::B), "denoised_odd.R,denoised_odd.G,denoised_odd.B");
    assert_eq!(of(Role::Denoised, Buffer::Full), "denoised.R,denoised.G,denoised.B");
    assert_eq!(of(Role::Albedo, Buffer::A), "albedoA.R,albedoA.G,albedoA.B");
    assert_eq!(of(Role::Normal, Buffer::B), "normal.X,normal.Y,normal.Z");
    assert!(frame.warnings.iter().any(|line| line.contains("normal: one layer serves both halves")));
}

#[test]
fn every_role_can_be_overridden() {
    let folder = tempfile::tempdir().expect("folder");
    let (a, b) = write_halves(folder.path());
    let other = write_file(&folder.path().join("other.exr"), 3, &["x.R", "x.G", "x.B", "grey.Y", "U", "V", "W"]);
    let other = other.display();
    let overrides = [
        format!("radiance-a={other}:x"),
        format!("denoised-full={other}:U,V,W"),
        "denoised-b=albedo".to_string(),
        "albedo=normal.X,normal.X,normal.X".to_string(),
        "normal=none".to_string(),
        format!("visibility={other}:grey.Y"),
    ];
    let overrides: Vec<&str> = overrides.iter().map(String::as_str).collect();
    let frame = read(&FrameFiles::halves(a, b), &overrides).expect("frame");
    let of = |role, buffer| channels(&frame, role, buffer);
    assert_eq!(of(Role::Radiance, Buffer::A).as_deref(), Some("x.R,x.G,x.B"));
    assert_eq!(of(Role::Radiance, Buffer::B).as_deref(), Some("R,G,B"));
    assert_eq!(of(Role::Denoised, Buffer::Full).as_deref(), Some("U,V,W"));
    assert_eq!(of(Role::Denoised, Buffer::B).as_deref(), Some("albedo.R,albedo.G,albedo.B"));
    assert_eq!(of(Role::Albedo, Buffer::B).as_deref(), Some("normal.X,normal.X,normal.X"));
    assert_eq!(of(Role::Normal, Buffer::A), None);
    assert_eq!(of(Role::Visibility, Buffer::B).as_deref(), Some("grey.Y"));
    assert_eq!(frame.a.radiance.at(1, 0, 0), value(3, "x.G", 0));
}

#[test]
fn separate_files_and_the_papers_folders_are_read() {
    let folder = tempfile::tempdir().expect("folder");
    let root = folder.path();
    let input = root.join("input/net/hall");
    let target = root.join("target/hall");
    std::fs::create_dir_all(&input).expect("folder");
    std::fs::create_dir_all(&target).expect("folder");
    let stems =
        ["randImgA", "randImgB", "denoImgA", "denoImgB", "denoImg", "albedoA", "albedoB", "visibilityA", "visibilityB"];
    for (seed, stem) in stems.iter().enumerate() {
        write_file(&input.join(format!("hall_8spp_{stem}.exr")), seed as u64, &["R", "G", "B"]);
    }
    write_file(&target.join("hall_ref.exr"), 99, &["R", "G", "B"]);
    let files = FrameFiles::paper_layout(root, "hall", 8, "net").expect("layout");
    let frame = read(&files, &[]).expect("frame");
    assert_eq!(frame.b.denoised.at(0, 0, 0), value(3, "R", 0));
    assert_eq!(frame.denoised.as_ref().expect("full").at(2, 0, 0), value(4, "B", 0));
    assert_eq!(frame.a.visibility.as_ref().expect("visibility").channels(), 1);
    assert!(frame.a.normal.is_none());
    assert!(read_reference(&files.reference.expect("reference"), None).expect("reference").halves.is_none());
    let missing = FrameFiles::paper_layout(root, "attic", 8, "net").expect_err("no such scene");
    assert!(missing.to_string().contains("attic"), "{missing}");
}

#[test]
fn a_reference_without_colour_is_the_mean_of_its_halves() {
    let folder = tempfile::tempdir().expect("folder");
    let file = write_file(&folder.path().join("ref.exr"), 1, &["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"]);
    let reference = read_reference(&file, None).expect("reference");
    let [a, b] = reference.halves.as_ref().expect("halves");
    assert_eq!(reference.mean.at(0, 1, 1), 0.5 * (a.at(0, 1, 1) + b.at(0, 1, 1)));
}

#[test]
fn absent_features_and_lossy_files_are_warned_of() {
    let folder = tempfile::tempdir().expect("folder");
    let lossy = |name: &str, seed| {
        let part = Part {
            channels: &HALF[..7],
            compression: exr::compression::Compression::B44,
            half: true,
            ..Part::default()
        };
        write_parts(&folder.path().join(name), seed, &[part])
    };
    let frame = read(&FrameFiles::halves(lossy("a.exr", 1), lossy("b.exr", 2)), &[]).expect("frame");
    for line in [
        "no albedo",
        "no normal",
        "no visibility",
        "no denoised full buffer",
        "noisy colour of half a was stored with lossy B44",
    ] {
        assert!(frame.warnings.iter().any(|warning| warning.contains(line)), "{line}: {:?}", frame.warnings);
    }
    assert!(frame.warnings.iter().all(|line| !line.contains('\n')));
}

#[test]
fn a_feature_of_one_half_only_is_not_used() {
    let folder = tempfile::tempdir().expect("folder");
    let (a, _) = write_halves(folder.path());
    let b = write_file(&folder.path().join("bare.exr"), 2, &HALF[..7]);
    let frame = read(&FrameFiles::halves(a, b), &[]).expect("frame");
    assert!(frame.a.albedo.is_none() && frame.b.albedo.is_none());
    assert!(frame.warnings.iter().any(|line| line.contains("albedo: only half a has it")));
}

#[test]
fn a_second_view_layer_is_passed_over_and_said_so() {
    let folder = tempfile::tempdir().expect("folder");
    let list = names(
        "One.Combined.R One.Combined.G One.Combined.B Two.Combined.R Two.Combined.G Two.Combined.B denoised.R denoised.G denoised.B",
    );
    let files = FrameFiles::halves(
        write_file(&folder.path().join("a.exr"), 1, &list),
        write_file(&folder.path().join("b.exr"), 2, &list),
    );
    let frame = read(&files, &[]).expect("frame");
    assert_eq!(
        channels(&frame, Role::Radiance, Buffer::B).as_deref(),
        Some("One.Combined.R,One.Combined.G,One.Combined.B")
    );
    assert!(frame.warnings.iter().any(|line| line.contains("passed over Two.Combined")), "{:?}", frame.warnings);
}

#[test]
fn correlated_neighbours_are_warned_of() {
    use sspc_image::Image;
    let folder = tempfile::tempdir().expect("folder");
    let size = (64, 48);
    let noise = |seed| Image::from_fn(3, size.1, size.0, |c, y, x| value(seed, ["R", "G", "B"][c], y * size.0 + x));
    let write = |name: &str, picture: &Image| -> std::path::PathBuf {
        let path = folder.path().join(name);
        sspc_testkit::exr_parts::write_picture(&path, picture);
        path
    };
    let blur = |a: &Image| Image::from_fn(3, size.1, size.0, |c, y, x| a.at(c, y, x) + a.at(c, y, (x + 1) % size.0));
    let flat = write("za.exr", &Image::filled(3, size.1, size.0, 0.5));
    let flat_b = write("zb.exr", &Image::filled(3, size.1, size.0, 0.501));
    let frame = |a: &Path, b: &Path| {
        let files = FrameFiles::halves(a, b).with_denoised(Some(flat.clone()), Some(flat_b.clone()), None);
        read(&files, &[]).expect("frame")
    };
    let said = |frame: &ReadFrame, text: &str| frame.warnings.iter().any(|line| line.contains(text));
    let independent = frame(&write("a.exr", &noise(1)), &write("b.exr", &noise(2)));
    assert!(!said(&independent, "correlated"), "{:?}", independent.warnings);
    let (a, b) = (blur(&noise(1)), blur(&noise(2)));
    assert!(said(&frame(&write("sa.exr", &a), &write("sb.exr", &b)), "neighbouring pixels is correlated"));
}

#[test]
fn pictures_are_what_a_viewer_shows() {
    let folder = tempfile::tempdir().expect("folder");
    let list = names("L.Noisy.R L.Combined.R L.Combined.G L.Combined.B");
    let file = write_file(&folder.path().join("p.exr"), 5, &list);
    assert_eq!(read_picture(&file, None).expect("picture").at(1, 0, 0), value(5, "L.Combined.G", 0));
}

#[test]
fn a_single_mark_of_a_half_is_a_part_of_a_name() {
    let folder = tempfile::tempdir().expect("folder");
    let path = |name: &str| folder.path().join(name);
    let (a, b) = write_halves(folder.path());
    for layer in ["ShotA", "set_b", "a", "Odd"] {
        let list = ["Combined.R", "Combined.G", "Combined.B", "Albedo.R", "Albedo.G", "Albedo.B"];
        let list = list.map(|name| format!("{layer}.{name}"));
        let file = write_file(&path("one.exr"), 5, &list.each_ref().map(String::as_str));
        let red = value(5, &list[0], 0);
        assert_eq!(read_picture(&file, None).expect("picture").at(0, 0, 0), red, "{layer}");
        let reference = read_reference(&file, None).expect("reference");
        assert!(reference.mean.at(0, 0, 0) == red && reference.halves.is_none(), "{layer}");
        let files = FrameFiles::halves(&a, &b).with_denoised(None, None, Some(file));
        assert_eq!(read(&files, &[]).expect("frame").denoised.as_ref().expect("full").at(0, 0, 0), red, "{layer}");
    }
    let list = names("a.Combined.R a.Combined.G a.Combined.B b.Combined.R b.Combined.G b.Combined.B");
    let both = write_file(&path("both.exr"), 5, &list);
    assert!(read_picture(&both, None).is_err(), "neither half is the picture");
    assert!(read_reference(&both, None).expect("reference").halves.is_some());
}

/// Fails when differences are looked for in frames that are not trained on, or one half's alone are taken.
#[test]
fn differences_are_found_by_their_names_where_they_are_wanted() {
    let folder = tempfile::tempdir().expect("folder");
    let file = |name: &str, seed, differences: &[&str]| {
        let mut all = names("R G B denoised.R denoised.G denoised.B");
        all.extend(differences);
        write_file(&folder.path().join(name), seed, &all)
    };
    let both = names("dx.R dx.G dx.B Gradient_Y.X Gradient_Y.Y Gradient_Y.Z");
    let [a, b] = [("a.exr", 1), ("b.exr", 2)].map(|(name, seed)| file(name, seed, &both));
    let plain = file("plain.exr", 3, &[]);
    let open = |b: &Path, overrides: &[&str]| {
        let overrides = RoleOverrides::parse(overrides).expect("overrides").with_differences();
        OpenFrame::open(&FrameFiles::halves(&a, b), &overrides).expect("frame")
    };
    let found = open(&b, &[]);
    for (role, name) in [(Role::Dx, "dx.R"), (Role::Dy, "Gradient_Y.X")] {
        let rows = found.role_rows(role, Buffer::B, 0..H).expect("rows").expect("differences");
        assert_eq!(rows.at(0, H - 1, 2), value(2, name, (H - 1) * W + 2));
    }
    assert!(!open(&b, &["dy=none"]).has(Role::Dy, Buffer::A));
    assert!(open(&b, &["dx=Gradient_Y"]).has(Role::Dx, Buffer::B));
    let lonely = open(&plain, &[]);
    assert!(!lonely.has(Role::Dx, Buffer::A) && !lonely.has(Role::Dy, Buffer::A));
    assert!(
        lonely.notes().iter().any(|note| note.contains("horizontal differences: only half a")),
        "{:?}",
        lonely.notes()
    );
    let unwanted = OpenFrame::open(&FrameFiles::halves(&a, &b), &RoleOverrides::none()).expect("frame");
    assert!(!unwanted.has(Role::Dx, Buffer::A));
}
