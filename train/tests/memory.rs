//! A fit holds a pixel's features once, and little beside them.
//! One test in a program of its own: the allocator counts whatever runs at the same time.

use clap::Parser;
use sspc_testkit::peak::{PeakAlloc, peak_of};
use sspc_testkit::small_frame::SmallFrame;
use sspc_train::cli::{Cli, Command};
use sspc_train::fit_command;
use std::ffi::OsString;

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

const WIDTH: usize = 256;
/// What a pixel more may take at the peak, and no more. Features of both halves and the full buffer's z (29 f32), z as
/// read and the noisy preview are held from the first to the last (131 bytes); at the finish both halves' corrections
/// and the full buffer's come to them, and what the judge adds up (some 55). A second copy of the features would be 104
/// more, the parameters of all pixels 128, the frame as read 108.
const BYTES_A_PIXEL: usize = 220;
/// Buffers of the threads, of which sometimes more and sometimes fewer live at once.
const SCATTER: usize = 2 << 20;

#[test]
fn memory_for_a_pixel_is_bounded() {
    let peak = |height: usize| {
        let folder = tempfile::tempdir().expect("folder");
        let frame = SmallFrame::write(folder.path(), WIDTH, height);
        let roles = frame.write_features(folder.path(), WIDTH, height);
        let out = folder.path().join("out");
        let mut arguments = ["sspc-train", "fit", "--quiet", "--steps", "2", "-o"].map(OsString::from).to_vec();
        arguments.push(out.into());
        arguments.extend(frame.arguments().map(OsString::from));
        arguments.extend(roles.iter().flat_map(|role| ["--role", role]).map(OsString::from));
        let Command::Fit(arguments) = Cli::parse_from(arguments).command else { unreachable!("fit was asked for") };
        let (outcome, bytes) = peak_of(&ALLOCATOR, || fit_command::run(&arguments));
        outcome.expect("fitted");
        bytes
    };
    // Once without looking: threads stay.
    peak(16);
    let (low, high) = (peak(1024), peak(2048));
    let more = 1024 * WIDTH;
    println!("{low} and {high} bytes: {:.1} for a pixel more", (high - low) as f64 / more as f64);
    assert!(high - low < BYTES_A_PIXEL * more + SCATTER, "{low} bytes, and {high} for twice the rows");
}
