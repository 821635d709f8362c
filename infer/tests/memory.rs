//! A frame that is read in bands takes memory for its bands and its picture, however many rows it has.
//! One test in a program of its own: the allocator counts whatever runs at the same time.

use sspc_cli::reading::ReadFrame;
use sspc_core::bands::FrameBands;
use sspc_core::correct::{BYTES_PER_PIXEL, CorrectionSettings, correct};
use sspc_core::frame_stats::{Exposure, FrameStats};
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_frames::{FrameFiles, OpenFrame, RoleOverrides};
use sspc_image::{Buffer, Image, Role};
use sspc_infer::engine::{Engine, Kernels};
use sspc_kernels::parameters::Form;
use sspc_kernels::simd::Isa;
use sspc_onnx::{Contract, Model};
use sspc_testkit::exr_parts::write_picture;
use sspc_testkit::frames::read_frame;
use sspc_testkit::method::{self, settings};
use sspc_testkit::peak::{PeakAlloc, peak_of};
use std::path::Path;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const WIDTH: usize = 128;
const BAND: usize = 64;
/// Rows around a band: networks, windows and judgement.
const AROUND: usize = 2 * 48;
/// The corrected picture, and the brightness of every pixel while the frame is looked over, of which one is gone
/// before the other comes. Holding the frame would take 108.
const BYTES_A_PIXEL_MORE: usize = 16;
/// Buffers of the threads that read, of which sometimes more and sometimes fewer live at once. Holding the frame
/// would take 5 MiB more for these rows.
const SCATTER: usize = 1 << 20;

/// Files of colour, albedo and normal for both halves, 27 planes.
fn frame(folder: &Path, height: usize) -> FrameFiles {
    let mut rng = Rng::new(3);
    let mut write = |name: String, level: f32| {
        let picture = Image::from_fn(3, height, WIDTH, |c, y, x| {
            0.2 + 0.3 * ((x / 9 + y / 7 + c) % 2) as f32 + level * rng.uniform()
        });
        let path = folder.join(format!("{name}-{height}.exr"));
        write_picture(&path, &picture);
        path
    };
    let halves = FrameFiles::halves(write("a".into(), 1.0), write("b".into(), 1.0));
    let denoised = Role::Denoised;
    let mut files = halves.with_role(denoised, Buffer::Full, write("z".into(), 0.02));
    for (buffer, mark) in [(Buffer::A, "a"), (Buffer::B, "b")] {
        for (role, level) in [(denoised, 0.04), (Role::Albedo, 0.1), (Role::Normal, 0.1)] {
            files = files.with_role(role, buffer, write(format!("{role}-{mark}"), level));
        }
    }
    files
}

#[test]
fn memory_grows_with_the_picture_not_with_the_frame() {
    let folder = tempfile::tempdir().expect("folder");
    let contract = Contract::new(Form::Gated);
    let weights = start::analytic(contract.shape, 0.7, &mut Rng::new(1)).weights;
    let how = CorrectionSettings { rows: Some(BAND), keep_maps: false, ..settings(&contract) };
    let engine = Engine::new(Model::new(contract, weights).expect("a model"), Kernels::Fused(Isa::best()), 64);
    let files = [384, 768].map(|height| frame(folder.path(), height));
    let correct = |files: &FrameFiles| {
        peak_of(&ALLOCATOR, || {
            let open = OpenFrame::open(files, &RoleOverrides::none()).expect("frame");
            let ReadFrame { source, stats, .. } = ReadFrame::in_bands(open, Exposure::Normalised).expect("readable");
            let mut bands = FrameBands::new(&source, stats, true);
            (stats, correct(&mut bands, &engine, &how, &|| false).expect("corrected").picture)
        })
    };
    // Once without looking: threads and tract's plan stay.
    correct(&files[0]);
    let [((stats, picture), low), (_, high)] = files.each_ref().map(correct);
    let more = 384 * WIDTH;
    assert!(high - low < BYTES_A_PIXEL_MORE * more + SCATTER, "{low} bytes, and {high} for twice the rows");
    let band = (BAND + AROUND) * WIDTH * BYTES_PER_PIXEL;
    assert!(low < band + BYTES_A_PIXEL_MORE * more + SCATTER, "{low} bytes, {band} for the band");

    // The same picture as that of the frame in memory.
    let held = read_frame(&files[0], &RoleOverrides::none()).expect("frame");
    assert_eq!(stats, FrameStats::of(&held, Exposure::Normalised));
    assert!(method::correct(&held, stats, &engine, &how).picture == picture, "another picture");
}
