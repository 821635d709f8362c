//! The repository's own frames are read unasked and measure what they did when they were cut.

use sspc_frames::{FrameFiles, RoleOverrides, read_reference};
use sspc_image::{Buffer, Image, Role};
use sspc_metrics::rel_l2;
use sspc_testkit::frames::data;
use sspc_testkit::frames::read_frame;

/// relL2 of the files, computed once by a separate reading of the definition in another language.
const NOISY: f64 = 0.013_776_599_29;
const DENOISED: f64 = 0.001_851_655_15;
/// Both sum in f64; only the order of terms and the digits written above differ.
const SAME: f64 = 1e-8;

#[test]
fn the_sample_is_complete() {
    let root = data("sample");
    let files = FrameFiles::halves(root.join("a.exr"), root.join("b.exr")).with_denoised(
        None,
        None,
        Some(root.join("denoised.exr")),
    );
    let frame = read_frame(&files, &RoleOverrides::none()).expect("sample");
    assert_eq!((frame.width(), frame.height()), (256, 192));
    assert_eq!(frame.warnings, Vec::<String>::new());
    assert_eq!(frame.sources.len(), 11);
    let reference = read_reference(&root.join("ref.exr"), None).expect("reference");
    let noisy = rel_l2(&Image::mean_of(&frame.a.radiance, &frame.b.radiance), &reference);
    let denoised = rel_l2(frame.denoised.as_ref().expect("denoised"), &reference);
    println!("noisy {noisy:?}\ndenoised {denoised:?}");
    assert!((noisy.value / NOISY - 1.0).abs() < SAME, "noisy {}", noisy.value);
    assert!((denoised.value / DENOISED - 1.0).abs() < SAME, "denoised {}", denoised.value);
    assert_eq!((noisy.excluded, denoised.excluded), (0, 0));
}

#[test]
fn blenders_parts_fill_the_roles() {
    let root = data("blender");
    let files = FrameFiles::halves(root.join("a.exr"), root.join("b.exr")).with_denoised(
        Some(root.join("denoised-a.exr")),
        Some(root.join("denoised-b.exr")),
        Some(root.join("denoised.exr")),
    );
    let frame = read_frame(&files, &RoleOverrides::none()).expect("frame");
    assert_eq!((frame.width(), frame.height()), (96, 64));
    let named: Vec<String> = frame
        .sources
        .iter()
        .filter(|source| source.buffer == Buffer::A)
        .map(|source| source.channels.join(","))
        .collect();
    assert_eq!(
        named,
        [
            "ViewLayer.Combined.R,ViewLayer.Combined.G,ViewLayer.Combined.B",
            "R,G,B",
            "ViewLayer.Denoising Albedo.R,ViewLayer.Denoising Albedo.G,ViewLayer.Denoising Albedo.B",
            "ViewLayer.Denoising Normal.X,ViewLayer.Denoising Normal.Y,ViewLayer.Denoising Normal.Z",
        ]
    );
    assert!(frame.a.visibility.is_none());
    assert_eq!(frame.warnings, ["no visibility: shadow edges are told from noise by colour alone"]);
    assert!(frame.sources.iter().all(|source| source.role != Role::Visibility));
}
