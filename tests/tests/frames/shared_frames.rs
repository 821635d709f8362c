//! The reader on whole renders of several renderers and layouts. The frames lie beside the repository and are
//! not needed: without them every test says that it was skipped.

use sspc_frames::{FrameFiles, RoleOverrides, read_picture, read_reference};
use sspc_image::{Buffer, Role};
use sspc_metrics::rel_l2;
use sspc_testkit::frames::read_frame;
use sspc_testkit::skips::skipped;
use std::path::PathBuf;

fn frames(folder: &str) -> Option<PathBuf> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../shared/frames").join(folder);
    if path.is_dir() {
        return Some(path);
    }
    skipped(folder, "no such frames beside the repository");
    None
}

#[test]
fn halves_with_layers_are_read_unasked() {
    let measured = [
        // From the frames' own record; the last digit is rounding.
        ("staircase", "16spp", 0.00719, 0.0413),
        ("staircase", "64spp", 0.00244, 0.01052),
        ("living-room", "64spp", 0.0134, 0.152),
        ("dining-room", "64spp", 0.0112, 0.527),
    ];
    for (folder, name, denoised, noisy) in measured {
        let Some(root) = frames(folder) else { return };
        let files = FrameFiles::halves(root.join(format!("{name}.a.exr")), root.join(format!("{name}.b.exr")))
            .with_denoised(None, None, Some(root.join(format!("{name}.denoised.exr"))));
        let frame = read_frame(&files, &RoleOverrides::none()).expect(folder);
        assert!(frame.a.albedo.is_some() && frame.b.normal.is_some() && frame.b.visibility.is_some());
        assert_eq!(frame.warnings, Vec::<String>::new(), "{folder} {name}");
        assert_eq!(frame.sources.len(), 11);
        let reference = read_reference(&root.join("ref.exr"), None).expect("reference");
        assert!(reference.halves.is_some());
        let picture = sspc_image::Image::mean_of(&frame.a.radiance, &frame.b.radiance);
        let close = |found: f64, expected: f64| (found / expected - 1.0).abs() < 0.01;
        let found = rel_l2(&picture, &reference).value;
        assert!(close(found, noisy), "{folder} {name}: noisy {found} instead of {noisy}");
        let found = rel_l2(frame.denoised.as_ref().expect("denoised"), &reference).value;
        assert!(close(found, denoised), "{folder} {name}: denoised {found} instead of {denoised}");
    }
}

#[test]
fn blenders_parts_are_read_unasked() {
    let Some(root) = frames("fur-blender") else { return };
    let files = FrameFiles::halves(root.join("a.exr"), root.join("b.exr")).with_denoised(
        Some(root.join("denoised-a.exr")),
        Some(root.join("denoised-b.exr")),
        Some(root.join("denoised.exr")),
    );
    let frame = read_frame(&files, &RoleOverrides::none()).expect("frame");
    let named = |role, buffer| {
        let source = frame.sources.iter().find(|s| (s.role, s.buffer) == (role, buffer)).expect("source");
        source.channels.join(",")
    };
    assert_eq!(named(Role::Radiance, Buffer::A), "ViewLayer.Combined.R,ViewLayer.Combined.G,ViewLayer.Combined.B");
    assert_eq!(
        named(Role::Normal, Buffer::B),
        "ViewLayer.Denoising Normal.X,ViewLayer.Denoising Normal.Y,ViewLayer.Denoising Normal.Z"
    );
    assert_eq!(named(Role::Denoised, Buffer::Full), "R,G,B");
    assert!(frame.warnings.iter().any(|line| line.contains("no visibility")));
    assert_eq!((frame.width(), frame.height()), (480, 270));
}

#[test]
fn the_papers_folders_are_read() {
    let Some(root) = frames("paper-layout") else { return };
    let files = FrameFiles::paper_layout(&root, "staircase", 16, "oidn").expect("layout");
    let frame = read_frame(&files, &RoleOverrides::none()).expect("frame");
    assert_eq!(frame.sources.len(), 11);
    assert_eq!(frame.warnings, Vec::<String>::new());
    let reference = read_reference(files.reference.as_ref().expect("target"), None).expect("reference");
    let picture = read_picture(&files.a, None).expect("picture");
    assert!(picture.same_size(&reference.mean));
    // The same render in layers gives the same planes.
    let Some(layers) = frames("staircase") else { return };
    let files = FrameFiles::halves(layers.join("16spp.a.exr"), layers.join("16spp.b.exr"));
    let layered = read_frame(&files, &RoleOverrides::none()).expect("layers");
    assert_eq!(frame.a.radiance, layered.a.radiance);
    assert_eq!(frame.b.visibility, layered.b.visibility);
}
