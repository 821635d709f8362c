//! Denoised pictures that are not in the files of the halves: made elsewhere, or in further files.

use sspc_frames::error::{Error, ErrorKind};
use sspc_frames::{FrameFiles, Made, MadeVariant, OpenFrame, RoleOverrides};
use sspc_image::{Buffer, CompactImage, Image, Role};
use std::path::{Path, PathBuf};

const SIZE: (usize, usize) = (6, 4);

/// A file of R, G, B in each layer, all of one value.
fn write(path: &Path, layers: &[(&str, f32)], size: (usize, usize)) -> PathBuf {
    use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Layer};
    use exr::prelude::WritableImage;
    let channels = layers.iter().flat_map(|(layer, value)| {
        ["R", "G", "B"].map(|ending| {
            let name = if layer.is_empty() { ending.to_string() } else { format!("{layer}.{ending}") };
            AnyChannel::new(name.as_str(), FlatSamples::F32(vec![*value; size.0 * size.1]))
        })
    });
    let list = AnyChannels::sort(channels.collect());
    let layer = Layer::new(size, Default::default(), Encoding::FAST_LOSSLESS, list);
    exr::image::Image::from_layer(layer).write().to_file(path).expect("a test file");
    path.into()
}

/// Two halves: radiance 1 and 2, albedo 0.1 and 0.2, and what else is asked for.
fn halves(folder: &Path, more: &[(&str, f32)]) -> FrameFiles {
    let half = |name: &str, value: f32| {
        let layers = [&[("", value), ("albedo", 0.1 * value)], more].concat();
        write(&folder.join(name), &layers, SIZE)
    };
    FrameFiles::halves(half("a.exr", 1.0), half("b.exr", 2.0))
}

fn open(files: &FrameFiles, roles: &[&str]) -> Result<OpenFrame, Error> {
    OpenFrame::open_to_denoise(files, &RoleOverrides::parse(roles).expect("overrides"))
}

fn made(value: f32) -> CompactImage {
    CompactImage::of(&Image::filled(3, SIZE.1, SIZE.0, value))
}

/// A picture of one value.
fn value(image: &Image) -> f32 {
    assert!(image.data().iter().all(|v| *v == image.data()[0]), "one value");
    image.data()[0]
}

#[test]
fn a_frame_without_denoised_halves_waits_for_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = halves(folder.path(), &[]);
    let refused = OpenFrame::open(&files, &RoleOverrides::none()).err().expect("no denoised halves");
    assert_eq!(refused.kind(), ErrorKind::Input);
    let mut frame = open(&files, &[]).expect("a frame");
    assert_eq!(frame.undenoised().map(ToString::to_string), Some(refused.to_string()));
    assert!(frame.has(Role::Albedo, Buffer::A) && !frame.has(Role::Denoised, Buffer::A));
    let [a, b] = frame.noisy_rows(1..3).expect("rows");
    assert_eq!([value(&a.radiance), value(&b.radiance)], [1.0, 2.0]);
    assert_eq!(b.albedo.as_ref().map(value), Some(0.2));
    assert!(a.normal.is_none() && a.radiance.height() == 2);

    let planes = frame.planes();
    let variants = vec![MadeVariant { halves: [made(5.0), made(6.0)], full: made(7.0) }];
    frame.supply(Made { halves: Some([made(2.0), made(3.0)]), full: Some(made(4.0)), variants, composite: None });
    assert!(frame.undenoised().is_none());
    let rows = frame.rows(1..4).expect("rows");
    assert_eq!([value(&rows.a.denoised), value(&rows.b.denoised)], [2.0, 3.0]);
    assert_eq!(rows.denoised.as_ref().map(value), Some(4.0));
    let pictures = |i: usize| {
        let variant = &rows.variants[i];
        [value(&variant.halves[0]), value(&variant.halves[1]), variant.full.as_ref().map_or(0.0, value)]
    };
    // The first is z itself.
    assert_eq!(rows.variants.len(), 2);
    assert_eq!([pictures(0), pictures(1)], [[2.0, 3.0, 4.0], [5.0, 6.0, 7.0]]);
    assert_eq!(rows.variants[1].halves[0].height(), 3);
    assert_eq!((frame.planes() - planes, frame.variants()), (9 + 18, 2), "memory of z and of both variants");
}

#[test]
fn one_denoised_half_alone_is_refused() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = write(&folder.path().join("za.exr"), &[("", 3.0)], SIZE);
    let files = halves(folder.path(), &[]);
    for (a, b, half) in [(Some(file.clone()), None, "half b"), (None, Some(file.clone()), "half a")] {
        let error = open(&files.clone().with_denoised(a, b, None), &[]).err().expect("one half alone");
        assert!(error.to_string().contains(&format!("no denoised colour of {half}")), "{error}");
    }
    // The full buffer alone says nothing of the halves, and is kept.
    let mut frame = open(&files.with_denoised(None, None, Some(file)), &[]).expect("a frame");
    assert!(frame.undenoised().is_some() && frame.has(Role::Denoised, Buffer::Full));
    frame.supply(Made { halves: Some([made(1.0), made(2.0)]), full: None, variants: Vec::new(), composite: None });
    let rows = frame.rows(0..4).expect("rows");
    assert_eq!(rows.denoised.as_ref().map(value), Some(3.0));
    assert!(rows.variants.is_empty());
}

#[test]
fn denoised_layers_can_be_left_aside() {
    let folder = tempfile::tempdir().expect("a folder");
    let files = halves(folder.path(), &[("denoised", 9.0)]);
    assert!(open(&files, &[]).expect("a frame").undenoised().is_none());
    let aside = open(&files, &["denoised=none"]).expect("a frame");
    assert!(aside.undenoised().is_some() && !aside.has(Role::Denoised, Buffer::B));
    let error = open(&files, &["denoised-a=none"]).err().expect("one half alone");
    assert!(error.to_string().contains("half a"), "{error}");
}

#[test]
fn further_files_follow_the_rules_of_the_first() {
    let folder = tempfile::tempdir().expect("a folder");
    let at = |name: &str| folder.path().join(name);
    let (za, zb) = (write(&at("za.exr"), &[("", 3.0)], SIZE), write(&at("zb.exr"), &[("", 4.0), ("soft", 5.0)], SIZE));
    let files = halves(folder.path(), &[("denoised", 9.0)]);
    let more = |text: String| files.clone().with_more_denoised(vec![text.parse().expect("files")]);
    let (za, zb) = (za.display(), zb.display());

    let with = more(format!("{za},{zb}:soft,{za}"));
    assert!(with.all().iter().filter(|path| path.ends_with("za.exr")).count() == 2, "inputs are protected");
    let frame = open(&with, &[]).expect("a frame");
    let sources = frame.sources();
    let further: Vec<_> = sources.iter().filter(|source| source.variant == 1).collect();
    assert_eq!(further.iter().map(|source| source.buffer).collect::<Vec<_>>(), [Buffer::A, Buffer::B, Buffer::Full]);
    assert_eq!(further[1].channels, ["soft.R", "soft.G", "soft.B"]);
    let rows = frame.rows(0..2).expect("rows");
    assert_eq!((rows.variants.len(), frame.variants()), (2, 2));
    let [first, second] = [0, 1].map(|i| rows.variants[i].halves.each_ref().map(value));
    assert_eq!([first, second], [[9.0, 9.0], [3.0, 5.0]]);
    assert_eq!([0, 1].map(|i| rows.variants[i].full.as_ref().map(value)), [None, Some(3.0)]);

    let wide = write(&at("wide.exr"), &[("", 3.0)], (SIZE.0 + 1, SIZE.1));
    let refused = |text: String, words: &[&str]| {
        let error = open(&more(text), &[]).err().expect("refused").to_string();
        assert!(words.iter().all(|word| error.contains(word)), "{error}");
    };
    refused(format!("{za},{}", wide.display()), &["wide.exr", "denoised colour of half b", "7x4"]);
    refused(format!("{za},{zb}:hard"), &["zb.exr", "'hard'"]);
    refused(format!("{za},{}", at("nowhere.exr").display()), &["nowhere.exr", "no such file"]);
}
