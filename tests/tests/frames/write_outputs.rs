//! Outputs keep what they were made from, appear whole or not at all, and never touch an input.

use exr::compression::Compression;
use exr::image::{AnyChannel, AnyChannels, Blocks, Encoding, FlatImage, FlatSamples, Layer, Levels};
use exr::math::{RoundingMode, Vec2};
use exr::meta::attribute::{AttributeValue, LineOrder, Preview, Text};
use exr::meta::header::LayerAttributes;
use exr::prelude::WritableImage;
use sspc_frames::atomic::{atomic_write_bytes, check_output};
use sspc_frames::error::{Error, ErrorKind};
use sspc_frames::{FrameFiles, RoleOverrides, atomic_write, read_picture};
use sspc_image::Image;
use sspc_testkit::exr_parts::{H, HALF, Part, W, value, write_file, write_over, write_parts};
use sspc_testkit::frames::read_frame;
use std::io::Write;
use std::path::{Path, PathBuf};

fn corrected() -> Image {
    Image::from_fn(3, H, W, |c, y, x| 0.25 + c as f32 + 0.5 * (y * W + x) as f32)
}

fn load(path: &Path) -> FlatImage {
    exr::prelude::read_all_flat_layers_from_file(path).expect("written file")
}

/// All channels of all parts as (part name, channel name, samples).
fn channels(image: &FlatImage) -> Vec<(String, String, FlatSamples)> {
    let of_layer = |layer: &exr::image::Layer<exr::image::AnyChannels<FlatSamples>>| {
        let part = layer.attributes.layer_name.as_ref().map(ToString::to_string).unwrap_or_default();
        let list = layer.channel_data.list.iter();
        list.map(|c| (part.clone(), c.name.to_string(), c.sample_data.clone())).collect::<Vec<_>>()
    };
    image.layer_data.iter().flat_map(of_layer).collect()
}

/// Every channel but `replaced` is what it was.
fn assert_kept(before: &FlatImage, after: &FlatImage, replaced: &[&str]) {
    let (before, after) = (channels(before), channels(after));
    for (part, name, samples) in &before {
        let found = after.iter().find(|(p, n, _)| (p, n) == (part, name)).unwrap_or_else(|| panic!("{part} {name}"));
        assert_eq!(found.2 == *samples, !replaced.contains(&name.as_str()), "{part} {name}");
    }
}

fn leftovers(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).expect("folder").map(|entry| entry.expect("entry").path());
    entries.filter(|path| path.extension().is_some_and(|e| e == "tmp")).collect()
}

fn provenance() -> Vec<(String, String)> {
    vec![("sspc/version".into(), "0.1.0".into()), ("sspc/note".into(), "Größe, naïve".into())]
}

#[test]
fn one_part_keeps_its_other_channels_windows_and_attributes() {
    let folder = tempfile::tempdir().expect("folder");
    let part = Part { channels: HALF, half: true, position: (3, -2), ..Part::default() };
    let a = write_parts(&folder.path().join("a.exr"), 1, &[part]);
    let out = folder.path().join("out.exr");
    write_over(&out, &a, &corrected(), &provenance()).expect("written");
    let (before, after) = (load(&a), load(&out));
    assert_kept(&before, &after, &["R", "G", "B"]);
    assert_eq!(after.attributes, before.attributes);
    assert_eq!(after.layer_data[0].attributes.layer_position, before.layer_data[0].attributes.layer_position);
    let note = &after.layer_data[0].attributes.other[&Text::from("sspc/note")];
    assert_eq!(note, &AttributeValue::Text(Text::from_slice_unchecked("Größe, naïve".as_bytes())));
    let red = after.layer_data[0].channel_data.list.iter().find(|c| c.name.to_string() == "R").expect("R");
    assert!(matches!(red.sample_data, FlatSamples::F16(_)), "half stays half");
    assert_eq!(read_picture(&out, None).expect("picture"), corrected());
}

/// Fails when attributes come in the order of a hash map, which is another one in every map.
#[test]
fn the_same_picture_gives_the_same_bytes() {
    let folder = tempfile::tempdir().expect("folder");
    let part = |name| Part { name, channels: HALF, half: true, ..Part::default() };
    let one = write_parts(&folder.path().join("one.exr"), 1, &[part("")]);
    let more = Part { name: "depth", channels: &["Z"], ..Part::default() };
    let two = write_parts(&folder.path().join("two.exr"), 1, &[part("beauty"), more]);
    let provenance: Vec<_> = (0..9).map(|i| (format!("sspc.attribute{i}"), format!("value {i}"))).collect();
    for template in [one, two] {
        let outputs = ["first", "second", "third"].map(|name| {
            let path = folder.path().join(name).with_extension("exr");
            write_over(&path, &template, &corrected(), &provenance).expect("written");
            let written = &load(&path).layer_data[0].attributes.other;
            assert!(provenance.iter().all(|(name, _)| written.contains_key(&Text::from(name.as_str()))), "{written:?}");
            std::fs::read(path).expect("written")
        });
        assert!(outputs[0] == outputs[1] && outputs[0] == outputs[2], "other bytes");
    }
}

#[test]
fn every_part_is_kept_and_the_shown_one_replaced() {
    let folder = tempfile::tempdir().expect("folder");
    let parts = [
        Part {
            name: "L.Combined",
            channels: &["L.Combined.R", "L.Combined.G", "L.Combined.B", "L.Combined.A"],
            ..Part::default()
        },
        Part { name: "L.Depth", channels: &["L.Depth.Z"], compression: Compression::PIZ, ..Part::default() },
        Part { name: "L.Index", channels: &["L.Index.X"], half: true, ..Part::default() },
    ];
    let a = write_parts(&folder.path().join("a.exr"), 1, &parts);
    let out = folder.path().join("out.exr");
    write_over(&out, &a, &corrected(), &provenance()).expect("written");
    let (before, after) = (load(&a), load(&out));
    assert_eq!(after.layer_data.len(), 3);
    assert_kept(&before, &after, &["L.Combined.R", "L.Combined.G", "L.Combined.B"]);
    assert!(after.layer_data[0].attributes.other.contains_key(&Text::from("sspc/version")));
    assert_eq!(read_picture(&out, None).expect("picture"), corrected());
}

#[test]
fn a_file_of_marked_halves_gets_root_colour() {
    let folder = tempfile::tempdir().expect("folder");
    let layers = ["even", "odd", "denoised_even", "denoised_odd"];
    let names = layers.map(|layer| ["R", "G", "B"].map(|c| format!("{layer}.{c}"))).concat();
    let a = write_file(&folder.path().join("a.exr"), 1, &names.iter().map(String::as_str).collect::<Vec<_>>());
    let out = folder.path().join("out.exr");
    write_over(&out, &a, &corrected(), &[]).expect("written");
    assert_kept(&load(&a), &load(&out), &[]);
    assert_eq!(read_picture(&out, None).expect("picture"), corrected());
}

#[test]
fn values_that_half_floats_cannot_hold_become_f32() {
    let folder = tempfile::tempdir().expect("folder");
    let a = write_parts(&folder.path().join("a.exr"), 1, &[Part { channels: HALF, half: true, ..Part::default() }]);
    let out = folder.path().join("out.exr");
    for scale in [1e6, 1e-6] {
        let picture = Image::from_fn(3, H, W, |c, y, x| scale * (1.0 + value(4, "R", c + y * W + x)));
        write_over(&out, &a, &picture, &[]).expect("written");
        assert_eq!(read_picture(&out, None).expect("picture"), picture, "scale {scale}");
    }
}

#[test]
fn lossy_parts_are_stored_without_further_loss() {
    let folder = tempfile::tempdir().expect("folder");
    let part = Part { channels: HALF, half: true, compression: Compression::B44, ..Part::default() };
    let a = write_parts(&folder.path().join("a.exr"), 1, &[part]);
    let out = folder.path().join("out.exr");
    write_over(&out, &a, &corrected(), &[]).expect("written");
    assert_eq!(load(&out).layer_data[0].encoding.compression, Compression::ZIP16);
    assert_kept(&load(&a), &load(&out), &["R", "G", "B"]);
}

#[test]
fn inputs_folders_and_links_are_never_written_to() {
    let folder = tempfile::tempdir().expect("folder");
    let a = write_file(&folder.path().join("a.exr"), 1, HALF);
    let original = std::fs::read(&a).expect("read");
    let hard = folder.path().join("hard.exr");
    std::fs::hard_link(&a, &hard).expect("hard link");
    let dotted = folder.path().join("./x/../a.exr");
    std::fs::create_dir(folder.path().join("x")).expect("folder");
    for out in [&a, &hard, &dotted, &folder.path().join("x"), &folder.path().join("nowhere/out.exr")] {
        let error = write_over(out, &a, &corrected(), &[]).expect_err("refused");
        assert!(matches!(error, Error::Output { .. }), "{error}");
        assert_eq!(error.kind(), ErrorKind::Output);
        assert!(!error.to_string().contains('\n'));
    }
    assert_eq!(std::fs::read(&a).expect("read"), original);
    assert_eq!(leftovers(folder.path()), Vec::<PathBuf>::new());
}

#[cfg(unix)]
#[test]
fn a_link_at_the_output_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let outside = folder.path().join("outside");
    std::fs::create_dir(&outside).expect("folder");
    let target = outside.join("precious");
    std::fs::write(&target, "precious").expect("written");
    let link = folder.path().join("out.json");
    std::os::unix::fs::symlink(&target, &link).expect("link");
    let error = atomic_write_bytes(&link, &[], b"{}").expect_err("refused");
    assert!(error.to_string().contains("symbolic link"), "{error}");
    assert_eq!(std::fs::read_to_string(&target).expect("read"), "precious");
}

#[test]
fn a_failed_write_leaves_the_old_file_and_nothing_else() {
    let folder = tempfile::tempdir().expect("folder");
    let out = folder.path().join("out.json");
    atomic_write_bytes(&out, &[], b"old").expect("written");
    let error = atomic_write(&out, &[], |file| {
        file.write_all(b"half of the new")?;
        Err(std::io::Error::other("the disk is full"))
    });
    let error = error.expect_err("failed");
    assert!(error.to_string().contains("the disk is full"), "{error}");
    assert_eq!(std::fs::read(&out).expect("read"), b"old");
    assert_eq!(leftovers(folder.path()), Vec::<PathBuf>::new());
    atomic_write_bytes(&out, &[], b"new").expect("written");
    assert_eq!(std::fs::read(&out).expect("read"), b"new");
}

#[test]
fn outputs_can_be_asked_for_beforehand() {
    let folder = tempfile::tempdir().expect("folder");
    let input = folder.path().join("in.exr");
    std::fs::write(&input, "x").expect("written");
    assert!(check_output(&folder.path().join("out.exr"), std::slice::from_ref(&input)).is_ok());
    assert!(check_output(&input, std::slice::from_ref(&input)).is_err());
    assert!(check_output(Path::new("/"), &[]).is_err());
}

/// Levels of detail and thumbnails of the picture that was.
#[test]
fn what_would_show_another_picture_is_left_out_and_said() {
    let folder = tempfile::tempdir().expect("folder");
    let sizes = [(W, H), (W / 2, H / 2), (1, 1)];
    let write = |name: &str, seed, levels: bool, preview: bool| {
        let list = HALF[..7].iter().map(|&name| {
            let level = |size: (usize, usize)| {
                FlatSamples::F32((0..size.0 * size.1).map(|pixel| value(seed, name, pixel)).collect())
            };
            let sample_data = match levels {
                true => Levels::Mip { rounding_mode: RoundingMode::Down, level_data: sizes.map(level).into() },
                false => Levels::Singular(level((W, H))),
            };
            AnyChannel { name: Text::from(name), sample_data, quantize_linearly: false, sampling: Vec2(1, 1) }
        });
        let preview = preview.then(|| Preview { size: Vec2(1, 1), pixel_data: vec![1, 2, 3, 4] });
        let attributes = LayerAttributes { preview, ..LayerAttributes::default() };
        let blocks = if levels { Blocks::Tiles(Vec2(4, 4)) } else { Blocks::ScanLines };
        let line_order = LineOrder::Increasing;
        let encoding = Encoding { blocks, line_order, compression: Compression::ZIP16 };
        let layer = Layer::new((W, H), attributes, encoding, AnyChannels::sort(list.collect()));
        let path = folder.path().join(name);
        exr::image::Image::from_layer(layer).write().to_file(&path).expect("a template");
        path
    };
    for (levels, preview, said) in [
        (true, true, "smaller levels of detail and thumbnail of R,G,B are not written"),
        (true, false, "smaller levels of detail of R,G,B are not written"),
        (false, true, "thumbnail of R,G,B are not written"),
        (false, false, ""),
    ] {
        let (a, b) = (write("a.exr", 1, levels, preview), write("b.exr", 2, levels, preview));
        let frame = read_frame(&FrameFiles::halves(&a, b), &RoleOverrides::none()).expect("a frame");
        let found = frame.warnings.iter().find(|line| line.contains("not written"));
        match (said, found) {
            ("", found) => assert_eq!(found, None),
            (said, found) => assert!(found.is_some_and(|line| line.contains(said)), "{said}: {found:?}"),
        }
        let out = folder.path().join("out.exr");
        write_over(&out, &a, &corrected(), &provenance()).expect("written");
        let after = load(&out);
        assert_kept(&load(&a), &after, &["R", "G", "B"]);
        assert!(after.layer_data[0].attributes.preview.is_none());
        let bytes = std::fs::read(&out).expect("read");
        let name = b"tiles\0tiledesc\0\x09\0\0\0";
        let tiles = bytes.windows(name.len()).position(|window| window == name).map(|at| bytes[at + name.len() + 8]);
        assert_eq!(tiles, levels.then_some(0), "one level");
    }
}
