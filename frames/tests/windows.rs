//! Pictures of one frame are laid over each other by their windows.

use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer};
use exr::meta::attribute::IntegerBounds;
use exr::meta::header::{ImageAttributes, LayerAttributes};
use exr::prelude::WritableImage;
use sspc_frames::read::{Like, read_placed_picture};
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides, Window, read_picture, read_reference};
use std::path::{Path, PathBuf};

const DISPLAY: Window = Window { left: 0, top: 0, width: 64, height: 48 };
const CROP: Window = Window { left: 10, top: 6, width: 30, height: 24 };

/// Tells a pixel of the frame, a file and a layer.
fn value(seed: usize, layer: usize, x: i32, y: i32) -> f32 {
    (1000 * seed + 100_000 * layer) as f32 + (x + 100 * y) as f32 / 8192.0
}

/// R, G, B of each layer in this window.
fn write(path: PathBuf, seed: usize, layers: &[&str], window: Window, display: Window) -> PathBuf {
    let channel = |(number, layer): (usize, &&str), ending: &str| {
        let pixels = (0..window.height * window.width).map(|i| {
            value(seed, number, window.left + (i % window.width) as i32, window.top + (i / window.width) as i32)
        });
        let name = if layer.is_empty() { ending.to_string() } else { format!("{layer}.{ending}") };
        AnyChannel::new(name.as_str(), FlatSamples::F32(pixels.collect()))
    };
    let list = layers.iter().enumerate().flat_map(|layer| ["R", "G", "B"].map(|ending| channel(layer, ending)));
    let own = LayerAttributes { layer_position: (window.left, window.top).into(), ..LayerAttributes::default() };
    let size = (window.width, window.height);
    let layer = Layer::new(size, own, Encoding::SMALL_LOSSLESS, AnyChannels::sort(list.collect()));
    let shared = ImageAttributes::new(IntegerBounds::new((display.left, display.top), (display.width, display.height)));
    Image { attributes: shared, layer_data: layer }.write().to_file(&path).expect("a test file");
    path
}

fn halves(folder: &Path, a: Window, b: Window, denoised: (Window, Window)) -> FrameFiles {
    let layers = ["", "denoised", "albedo"];
    let full = write(folder.join("full.exr"), 3, &[""], denoised.0, denoised.1);
    FrameFiles::halves(
        write(folder.join("a.exr"), 1, &layers, a, DISPLAY),
        write(folder.join("b.exr"), 2, &layers, b, DISPLAY),
    )
    .with_denoised(None, None, Some(full))
}

fn open(files: &FrameFiles) -> OpenFrame {
    OpenFrame::open(files, &RoleOverrides::none()).unwrap_or_else(|error| panic!("{error}"))
}

#[test]
fn crops_are_used_where_they_overlap() {
    let folder = tempfile::tempdir().expect("folder");
    for (b, full) in [(CROP.moved(-1, 2), DISPLAY), (CROP, CROP.moved(4, 0)), (CROP, CROP)] {
        let files = halves(folder.path(), CROP, b, (full, DISPLAY));
        let frame = open(&files);
        let window = CROP.overlap(&b).and_then(|w| w.overlap(&full)).expect("an overlap");
        assert_eq!(frame.placing().window, window);
        let read = frame.rows(2..5).expect("rows");
        let (x, y) = (window.left + 3, window.top + 2);
        assert_eq!(read.a.radiance.at(0, 0, 3), value(1, 0, x, y));
        assert_eq!(read.b.denoised.at(1, 0, 3), value(2, 1, x, y));
        assert_eq!(read.denoised.as_ref().expect("full").at(2, 0, 3), value(3, 0, x, y));
        assert_eq!(!frame.notes().is_empty(), (b, full) != (CROP, CROP), "{:?}", frame.notes());

        // The picture goes to its place; around it stays half a's denoised colour.
        let picture = sspc_image::Image::filled(3, window.height, window.width, 7.0);
        let out = folder.path().join("out.exr");
        frame.output().expect("an output").write(&out, &files.all(), &[&picture], &[]).expect("written");
        let (written, placing) = read_placed_picture(&out, None).expect("readable");
        assert_eq!(placing.window, CROP, "the template's window stays");
        for y in 0..CROP.height {
            for x in 0..CROP.width {
                let pixel = Window { left: CROP.left + x as i32, top: CROP.top + y as i32, width: 1, height: 1 };
                let expected = if window.contains(&pixel) { 7.0 } else { value(1, 1, pixel.left, pixel.top) };
                assert_eq!(written.at(0, y, x), expected, "{pixel}");
            }
        }
    }
}

#[test]
fn only_a_lost_origin_is_forgiven_and_aloud() {
    let folder = tempfile::tempdir().expect("folder");
    let lost = CROP.moved(-CROP.left, -CROP.top);
    let frame = open(&halves(folder.path(), CROP, CROP, (lost, lost)));
    assert_eq!(frame.rows(0..1).expect("rows").denoised.expect("full").at(0, 0, 0), value(3, 0, 0, 0));
    assert!(frame.notes().iter().any(|note| note.contains("taken for the same place")), "{:?}", frame.notes());

    let elsewhere = CROP.moved(3, 0);
    let files = halves(folder.path(), CROP, CROP, (elsewhere, elsewhere));
    let refused = OpenFrame::open(&files, &RoleOverrides::none());
    assert!(refused.is_err_and(|error| error.to_string().contains("30x24 at (13, 6)")), "another frame");
}

#[test]
fn a_feature_that_covers_less_is_missing_outside() {
    let folder = tempfile::tempdir().expect("folder");
    let files = halves(folder.path(), CROP, CROP, (CROP, DISPLAY));
    let small = Window { width: 10, ..CROP };
    let albedo = write(folder.path().join("albedo.exr"), 4, &[""], small, DISPLAY);
    let roles = format!("albedo={}", albedo.display());
    let frame = OpenFrame::open(&files, &roles.parse().expect("an override")).expect("a frame");
    assert_eq!(frame.placing().window, CROP);
    let albedo = frame.rows(0..2).expect("rows").a.albedo.expect("albedo");
    assert_eq!(albedo.at(0, 1, 9), value(4, 0, CROP.left + 9, CROP.top + 1));
    assert!(albedo.at(0, 1, 10).is_nan());
    assert!(frame.notes().iter().any(|note| note.contains("counts as missing elsewhere")), "{:?}", frame.notes());
}

#[test]
fn a_reference_of_the_whole_frame_serves_a_crop() {
    let folder = tempfile::tempdir().expect("folder");
    let crop = write(folder.path().join("crop.exr"), 1, &[""], CROP, DISPLAY);
    let whole = write(folder.path().join("ref.exr"), 2, &[""], DISPLAY, DISPLAY);
    let (_, placing) = read_placed_picture(&crop, None).expect("a picture");
    let like = Like { path: &crop, placing };
    let reference = read_reference(&whole, Some(like)).expect("a reference");
    assert_eq!((reference.mean.width(), reference.mean.height()), CROP.size());
    assert_eq!(reference.mean.at(0, 1, 2), value(2, 0, CROP.left + 2, CROP.top + 1));
    let (_, placing) = read_placed_picture(&whole, None).expect("a picture");
    let less = read_picture(&crop, Some(Like { path: &whole, placing }));
    assert!(less.is_err_and(|error| error.to_string().contains("64x48")), "a crop is no reference of the whole");
}
