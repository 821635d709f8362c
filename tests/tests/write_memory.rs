//! Writing a picture into a copy of a file takes memory for some rows of the file, however many channels it has.
//! One test in a program of its own: the allocator counts whatever runs at the same time.

use exr::image::{AnyChannel, AnyChannels, Encoding, FlatSamples, Layer};
use exr::meta::header::LayerAttributes;
use exr::prelude::WritableImage;
use sspc_frames::read_picture;
use sspc_image::Image;
use sspc_testkit::exr_parts::write_over;
use sspc_testkit::peak::{PeakAlloc, peak_of};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const HEIGHT: usize = 512;
const WIDTH: usize = 1024;
/// Light groups and mattes of a production file.
const OTHERS: usize = 96;

/// Rows of 24 MiB as read, decompressed, as written, and as compressed; the file's pixels take 208 MB.
const BOUND: usize = 100 << 20;

#[test]
fn many_channels_do_not_take_more_memory() {
    let folder = tempfile::tempdir().expect("folder");
    let template = folder.path().join("template.exr");
    {
        let plane = |value: usize| FlatSamples::F32((0..HEIGHT * WIDTH).map(|i| (i % 251 + value) as f32).collect());
        let others = (0..OTHERS).map(|at| AnyChannel::new(format!("light{at:03}.Y").as_str(), plane(at)));
        let colour = ["R", "G", "B"].map(|name| AnyChannel::new(name, plane(0)));
        let channels = AnyChannels::sort(others.chain(colour).collect());
        let layer = Layer::new((WIDTH, HEIGHT), LayerAttributes::default(), Encoding::UNCOMPRESSED, channels);
        exr::image::Image::from_layer(layer).write().to_file(&template).expect("template");
    }
    let picture = Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| (c * 7 + y * 3 + x) as f32);
    let out = folder.path().join("out.exr");
    let (written, peak) = peak_of(&ALLOCATOR, || write_over(&out, &template, &picture, &[]));
    written.expect("written");
    assert!(peak < BOUND, "{peak} bytes");
    assert_eq!(read_picture(&out, None).expect("picture"), picture);
    let length = |path| std::fs::metadata(path).expect("file").len();
    assert_eq!(length(&out), length(&template), "every channel is there");
}
