//! Files that are not the library: one line that says what was expected and what was found.
#![cfg(target_os = "linux")]

use sspc_oidn::search::Surroundings;
use sspc_oidn::{Oidn, OidnError};
use std::path::{Path, PathBuf};

fn put(folder: &Path, bytes: &[u8]) -> PathBuf {
    let path = folder.join("libOpenImageDenoise.so.2");
    std::fs::write(&path, bytes).expect("written");
    path
}

/// The error of a library that the user names.
fn error_of(path: &Path) -> OidnError {
    let surroundings = Surroundings { named: Some(path.into()), ..Surroundings::default() };
    match Oidn::find_in(&surroundings, 1) {
        Ok(_) => panic!("{} is taken for the library", path.display()),
        Err(error) => error,
    }
}

fn assert_says(error: &OidnError, words: &[&str]) {
    let text = error.to_string();
    assert!(words.iter().all(|word| text.contains(word)) && !text.contains('\n'), "{text}");
    assert!(!error.advice().is_empty());
}

#[test]
fn text_is_not_a_library() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = put(folder.path(), b"not a library");
    assert_says(&error_of(&path), &["libOpenImageDenoise.so.2", "cannot be opened as a library"]);
}

#[test]
fn another_processors_library_is_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let (machine, name) = if cfg!(target_arch = "aarch64") { (0x3e, "x86_64") } else { (0xb7, "aarch64") };
    let mut header = b"\x7fELF\x02\x01\x01\0\0\0\0\0\0\0\0\0\x03\0".to_vec();
    header.extend([machine, 0, 1, 0, 0, 0]);
    let path = put(folder.path(), &header);
    assert_says(&error_of(&path), &[std::env::consts::ARCH, "found one for", name]);
    header[4] = 1;
    let path = put(folder.path(), &header);
    assert_says(&error_of(&path), &["32 bits"]);
}

#[test]
fn another_library_is_not_this_one() {
    // The C library is the one shared object that every Linux has.
    let maps = std::fs::read_to_string("/proc/self/maps").expect("maps");
    let libc = maps.lines().filter_map(|line| line.split_whitespace().nth(5)).find(|path| path.contains("/libc.so"));
    let Some(libc) = libc else {
        eprintln!("skipped: no shared C library");
        return;
    };
    let folder = tempfile::tempdir().expect("a folder");
    let path = put(folder.path(), &std::fs::read(libc).expect("the C library"));
    assert_says(&error_of(&path), &["expected Open Image Denoise", "oidnNewDevice"]);
}

#[test]
fn what_is_found_and_cannot_be_used_is_passed_over_and_named() {
    let folder = tempfile::tempdir().expect("a folder");
    let lib = folder.path().join("lib");
    std::fs::create_dir(&lib).expect("a folder");
    put(&lib, b"not a library");
    let surroundings = Surroundings { conda_prefix: Some(folder.path().into()), ..Surroundings::default() };
    match Oidn::find_in(&surroundings, 1) {
        // A machine that has the library on its loader's path.
        Ok(oidn) => assert!(oidn.path().is_relative()),
        Err(error) => assert_says(&error, &["no Open Image Denoise", "passed over", "libOpenImageDenoise.so.2"]),
    }
}
