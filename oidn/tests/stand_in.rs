//! What a library can do wrong, by a stand-in that does it; skipped aloud without a C compiler.
#![cfg(target_os = "linux")]

use sspc_image::Image;
use sspc_oidn::{Mode, Oidn, OidnError, Picture, Quality, Rows, Run};
use sspc_testkit::c_programs::oidn_stand_in;
use tempfile::TempDir;

const RUN: Run = Run { quality: Quality::High, max_memory: 64, asked_to_stop: || false };
const HEIGHT: usize = 6;
const WIDTH: usize = 9;

/// The stand-in with this fault, opened; `None`, said aloud, without `cc`.
fn opened(fault: &str) -> Option<(TempDir, Result<Oidn, OidnError>)> {
    let folder = tempfile::tempdir().expect("a folder");
    let library = oidn_stand_in(folder.path(), fault)?;
    Some((folder, Oidn::open(&library, 1)))
}

fn colour() -> Image {
    Image::from_fn(3, HEIGHT, WIDTH, |c, y, x| 0.25 * (1 + c + y + x) as f32)
}

fn denoised(oidn: &Oidn, run: &Run) -> Result<Image, OidnError> {
    let picture = Picture::of(&Rows { colour: &colour(), albedo: None, normal: None });
    let denoised = oidn.denoise(picture, &[Mode::Colour], run)?;
    Ok(denoised[0].picture.rows(0..HEIGHT))
}

#[track_caller]
fn assert_says(error: &OidnError, words: &[&str]) {
    let text = error.to_string();
    assert!(words.iter().all(|word| text.contains(word)) && !text.contains('\n'), "{text}");
    assert!(!error.advice().is_empty());
}

#[test]
fn a_sound_library_is_believed() {
    let Some((_folder, oidn)) = opened("SOUND") else { return };
    let oidn = oidn.expect("a library");
    assert_eq!(oidn.version().to_string(), "2.3.0");
    let mut twice = colour();
    twice.data_mut().iter_mut().for_each(|value| *value *= 2.0);
    assert!(denoised(&oidn, &RUN).expect("denoised") == twice);
}

#[test]
fn what_cannot_be_used_is_refused_when_it_is_opened() {
    let cases = [
        ("OLD_1", "expected Open Image Denoise 2.0 or later, found 1.4.3"),
        ("OLD_VERSION", "expected Open Image Denoise 2.0 or later, found 1.99.1"),
        ("LACKS", "expected Open Image Denoise, found a library without oidnReleaseFilter"),
        ("NO_DEVICE", "cannot start: this processor is too old"),
        ("BAD_DEVICE", "cannot start: no thread could be started"),
    ];
    for (fault, words) in cases {
        let Some((_folder, oidn)) = opened(fault) else { return };
        let error = oidn.err().unwrap_or_else(|| panic!("{fault} is used"));
        assert_says(&error, &["libOpenImageDenoise.so.2: ", words]);
    }
}

#[test]
fn what_fails_while_it_works_gives_no_picture() {
    let cases = [
        ("NO_FILTER", "2.3.0 failed on 9x6 pixels (colour, high): unknown filter"),
        ("BAD_COMMIT", "2.3.0 failed on 9x6 pixels (colour, high): weights are missing"),
        ("HALF_WAY", "2.3.0 failed on 9x6 pixels (colour, high): out of memory"),
        ("NOT_FINITE", "2.3.0 returned 2 values of 9x6 pixels that are not finite (colour, high)"),
    ];
    for (fault, words) in cases {
        let Some((_folder, oidn)) = opened(fault) else { return };
        let oidn = oidn.expect("a library");
        let error = denoised(&oidn, &RUN).expect_err(fault);
        assert_says(&error, &[words]);
        // An error is told once, and the device goes on: a failure of before is not found again.
        assert_says(&denoised(&oidn, &RUN).expect_err(fault), &[words]);
    }
}

#[test]
fn a_library_that_is_asked_to_stop_stops() {
    let Some((_folder, oidn)) = opened("SOUND") else { return };
    let oidn = oidn.expect("a library");
    let stop = Run { asked_to_stop: || true, ..RUN };
    assert_eq!(denoised(&oidn, &stop).err(), Some(OidnError::Cancelled));
    assert!(denoised(&oidn, &RUN).is_ok());
}
