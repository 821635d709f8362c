//! How many samples each half has, by headers and passes.

use exr::meta::attribute::AttributeValue;
use sspc_frames::samples::{HalfSamples, SamplesSource};
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides};
use sspc_image::Image;
use std::path::{Path, PathBuf};

const SIZE: (usize, usize) = (6, 4);

/// A file of the layers, each of one value in R, G, B or in X, with attributes in its header.
fn write(path: &Path, layers: &[(&str, f32)], attributes: &[(&str, AttributeValue)]) -> PathBuf {
    use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Layer};
    use exr::meta::attribute::Text;
    use exr::meta::header::LayerAttributes;
    use exr::prelude::WritableImage;
    let channels = layers.iter().flat_map(|(layer, value)| {
        let endings = if layer.ends_with("Count") { &["X"][..] } else { &["R", "G", "B"] };
        endings.iter().map(move |ending| {
            let name = if layer.is_empty() { ending.to_string() } else { format!("{layer}.{ending}") };
            // Different in every pixel, so that halves are not identical; the mean of counts is kept.
            let around = |i: usize| if i.is_multiple_of(2) { 0.9 } else { 1.1 };
            let values = (0..SIZE.0 * SIZE.1).map(|i| value * around(i)).collect();
            AnyChannel::new(name.as_str(), FlatSamples::F32(values))
        })
    });
    let list = AnyChannels::sort(channels.collect());
    let other = attributes.iter().map(|(name, value)| (Text::from(*name), value.clone())).collect();
    let attributes = LayerAttributes { other, ..LayerAttributes::default() };
    let layer = Layer::new(SIZE, attributes, Encoding::FAST_LOSSLESS, list);
    exr::image::Image::from_layer(layer).write().to_file(path).expect("a test file");
    path.into()
}

fn text(value: &str) -> AttributeValue {
    AttributeValue::Text(value.into())
}

/// Two files of the colour in `layer`, each with its further layers and attributes.
fn open(layer: &str, halves: [(&[(&str, f32)], &[(&str, AttributeValue)]); 2], user: Option<[u32; 2]>) -> OpenFrame {
    let folder = tempfile::tempdir().expect("a folder");
    let [a, b] = [("a.exr", 1.0, halves[0]), ("b.exr", 2.0, halves[1])].map(|(name, value, (more, attributes))| {
        write(&folder.path().join(name), &[&[(layer, value)], more].concat(), attributes)
    });
    let files = FrameFiles::halves(a, b).with_samples(user);
    OpenFrame::open_to_denoise(&files, &RoleOverrides::none()).expect("a frame")
}

fn stamped(a: (&str, AttributeValue), b: (&str, AttributeValue)) -> OpenFrame {
    open("", [(&[], &[a]), (&[], &[b])], None)
}

fn metadata(counts: [f64; 2], name: &str) -> HalfSamples {
    HalfSamples { counts: Some(counts), source: SamplesSource::Metadata(name.into()) }
}

#[test]
fn attributes_of_renderers_are_understood() {
    let cycles = "cycles.ViewLayer.samples";
    assert_eq!(*stamped((cycles, text("32")), (cycles, text("8"))).samples(), metadata([32.0, 8.0], cycles));
    for name in ["samplesPerPixel", "IFM_iterations"] {
        let found = stamped((name, AttributeValue::I32(64)), (name, AttributeValue::I32(16)));
        assert_eq!(*found.samples(), metadata([64.0, 16.0], name));
        assert!([(0, 0.8), (1, 0.2)].iter().all(|(h, w)| (found.weights().of(*h) - w).abs() < 1e-6));
    }
}

#[test]
fn of_several_view_layers_the_one_of_the_colour_counts() {
    let attributes = [("cycles.Sky.samples", text("4")), ("cycles.Room.samples", text("24"))];
    let other = [("cycles.Sky.samples", text("400")), ("cycles.Room.samples", text("8"))];
    let found = open("Room.Combined", [(&[], &attributes), (&[], &other)], None);
    assert_eq!(*found.samples(), metadata([24.0, 8.0], "cycles.Room.samples"));
    // Which of them is the colour's cannot be told.
    assert_eq!(*open("", [(&[], &attributes), (&[], &other)], None).samples(), HalfSamples::UNKNOWN);
}

#[test]
fn what_only_one_half_says_or_none_can_have_is_left_alone() {
    let cycles = "cycles.ViewLayer.samples";
    let unknown = |found: &OpenFrame| *found.samples() == HalfSamples::UNKNOWN;
    assert!(unknown(&open("", [(&[], &[(cycles, text("32"))]), (&[], &[])], None)));
    assert!(unknown(&stamped((cycles, text("32")), ("samplesPerPixel", AttributeValue::I32(8)))));
    assert!(unknown(&stamped((cycles, text("many")), (cycles, text("8")))));
    for (a, b) in [("0", "8"), ("-4", "8"), ("NaN", "8"), ("1e30", "8"), ("4096", "2")] {
        let found = stamped((cycles, text(a)), (cycles, text(b)));
        assert!(unknown(&found), "{a} {b}");
        let notes = found.notes();
        assert!(notes.iter().any(|note| note.contains(cycles) && note.contains("not believed")), "{a} {b}: {notes:?}");
    }
}

#[test]
fn the_user_has_the_last_word_and_a_pass_comes_before_attributes() {
    let cycles = "cycles.ViewLayer.samples";
    let attributes = |count: &str| [(cycles, text(count))];
    let (a, b) = (attributes("64"), attributes("16"));
    // Cycles counts in shares of what was asked for.
    let [shares, others] = [[("ViewLayer.Debug Sample Count", 0.25)], [("ViewLayer.Debug Sample Count", 0.5)]];
    let layer = "ViewLayer.Combined";
    let by_pass = open(layer, [(&shares, &a), (&others, &b)], None);
    assert_eq!(by_pass.samples().source, SamplesSource::Pass);
    let counts = by_pass.samples().counts.expect("counts");
    assert!((counts[0] - 16.0).abs() < 1e-4 && (counts[1] - 8.0).abs() < 1e-4, "{counts:?}");
    let by_user = open(layer, [(&shares, &a), (&others, &b)], Some([5, 15]));
    assert_eq!(*by_user.samples(), HalfSamples { counts: Some([5.0, 15.0]), source: SamplesSource::User });
    // Shares of nobody knows what, and of one half alone.
    assert_eq!(*open(layer, [(&shares, &[]), (&others, &[])], None).samples(), HalfSamples::UNKNOWN);
    assert_eq!(*open(layer, [(&shares, &a), (&[], &b)], None).samples(), metadata([64.0, 16.0], cycles));
}

#[test]
fn rows_carry_the_weights_and_the_mean_obeys_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let half = |name: &str, value: f32| {
        write(
            &folder.path().join(name),
            &[("", value), ("denoised", value)],
            &[("samplesPerPixel", AttributeValue::I32(value as i32))],
        )
    };
    let files = FrameFiles::halves(half("a.exr", 3.0), half("b.exr", 1.0));
    let open = OpenFrame::open(&files, &RoleOverrides::none()).expect("a frame");
    let frame = open.rows(0..SIZE.1).expect("rows");
    assert_eq!(frame.weights, open.weights());
    let [mean] = &open.denoised_rows(sspc_image::Buffer::Full, 0..SIZE.1).expect("rows")[..] else { panic!("one") };
    let expected = Image::from_fn(3, SIZE.1, SIZE.0, |c, y, x| {
        0.75 * frame.a.denoised.at(c, y, x) + 0.25 * frame.b.denoised.at(c, y, x)
    });
    assert_eq!(mean.data(), expected.data());
}
