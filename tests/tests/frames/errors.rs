//! What is wrong with a frame is said in one line that names file, role, expected and found.

use sspc_frames::error::{Error, ErrorKind};
use sspc_frames::{FrameFiles, RoleOverrides, read_picture, read_reference};
use sspc_image::Image;
use sspc_testkit::exr_parts::{H, HALF, Part, W, write_file, write_halves, write_layers, write_parts};
use sspc_testkit::frames::read_frame;
use std::path::{Path, PathBuf};

fn error_of(files: &FrameFiles) -> Error {
    error_with(files, &[])
}

fn error_with(files: &FrameFiles, overrides: &[&str]) -> Error {
    let overrides = RoleOverrides::parse(overrides).expect("overrides");
    read_frame(files, &overrides).expect_err("a frame that must be refused")
}

/// One line, of kind input, that holds every word.
fn assert_says(error: &Error, words: &[&str]) {
    let line = error.to_string();
    assert!(!line.contains('\n') && !line.contains('\r'), "one line: {line:?}");
    assert_eq!(error.kind(), ErrorKind::Input, "{line}");
    assert!(!error.advice().is_empty() && !error.advice().contains('\n'));
    for word in words {
        assert!(line.contains(word), "'{word}' in: {line}");
    }
}

#[test]
fn files_that_are_not_there_or_not_exr() {
    let folder = tempfile::tempdir().expect("folder");
    let (a, b) = write_halves(folder.path());
    let nowhere = folder.path().join("nowhere.exr");
    assert_says(
        &error_of(&FrameFiles::halves(&a, &nowhere)),
        &["nowhere.exr", "no such file", "noisy colour of half b"],
    );
    let text = folder.path().join("text.exr");
    std::fs::write(&text, "these are\nnot pixels").expect("written");
    assert_says(
        &error_of(&FrameFiles::halves(&a, &text)),
        &["text.exr", "not an OpenEXR file", "these are\\nnot", "half b"],
    );
    let empty = folder.path().join("empty.exr");
    std::fs::write(&empty, "").expect("written");
    assert_says(&error_of(&FrameFiles::halves(&empty, &b)), &["empty.exr", "an empty file", "half a"]);
    let binary = folder.path().join("image.exr");
    std::fs::write(&binary, [0x89, b'P', b'N', b'G', 0, 1]).expect("written");
    assert_says(&error_of(&FrameFiles::halves(&a, &binary)), &["image.exr", "89 50 4e 47"]);
    assert_says(&error_of(&FrameFiles::halves(&a, folder.path())), &["a folder", "noisy colour of half b"]);
    let denoised = FrameFiles::halves(&a, &b).with_denoised(Some(nowhere.clone()), None, None);
    assert_says(&error_of(&denoised), &["nowhere.exr", "denoised colour of half a"]);
    assert_says(&read_reference(&nowhere, None).expect_err("missing"), &["nowhere.exr", "reference"]);
    assert_says(&read_picture(&nowhere, None).expect_err("missing"), &["nowhere.exr", "colour"]);
}

#[cfg(unix)]
#[test]
fn a_pipe_is_refused_and_not_waited_for() {
    let folder = tempfile::tempdir().expect("folder");
    let pipe = folder.path().join("pipe.exr");
    let made = std::process::Command::new("mkfifo").arg(&pipe).status();
    if !made.is_ok_and(|status| status.success()) {
        eprintln!("skipped: no mkfifo on this machine");
        return;
    }
    assert_says(&read_picture(&pipe, None).expect_err("pipe"), &["pipe.exr", "no regular file"]);
}

#[test]
fn truncated_files_are_refused_wherever_they_end() {
    let folder = tempfile::tempdir().expect("folder");
    let (a, b) = write_halves(folder.path());
    let whole = std::fs::read(&b).expect("read");
    let cut = folder.path().join("cut.exr");
    for length in (5..whole.len()).step_by(whole.len() / 61) {
        std::fs::write(&cut, &whole[..length]).expect("written");
        let error = error_of(&FrameFiles::halves(&a, &cut));
        assert_says(&error, &["cut.exr"]);
    }
    std::fs::write(&cut, &whole[..whole.len() - 1]).expect("written");
    assert_says(&error_of(&FrameFiles::halves(&a, &cut)), &["truncated or damaged", "half b"]);
}

#[test]
fn sizes_and_windows_must_agree() {
    let folder = tempfile::tempdir().expect("folder");
    let (a, b) = write_halves(folder.path());
    let write = |name: &str, channels: &[&str], size, position| {
        let part = Part { channels, size, position, ..Part::default() };
        write_parts(&folder.path().join(name), 3, &[part])
    };
    let tall = write("tall.exr", HALF, (W, H + 1), (0, 0));
    assert_says(
        &error_of(&FrameFiles::halves(&a, &tall)),
        &["tall.exr", "7x6", "7x5", "a.exr", "noisy colour of half b"],
    );
    let apart = write("apart.exr", HALF, (W, H), (W as i32, 0));
    assert_says(&error_of(&FrameFiles::halves(&a, &apart)), &["apart.exr", "7x5 at (7, 0)"]);
    let full = write("full.exr", &["R", "G", "B"], (W + 1, H), (0, 0));
    let files = FrameFiles::halves(&a, &b).with_denoised(None, None, Some(full.clone()));
    assert_says(&error_of(&files), &["full.exr", "denoised colour of the full buffer", "8x5"]);
    let (_, placing) = sspc_frames::read::read_placed_picture(&a, None).expect("picture");
    let like = sspc_frames::read::Like { placing, path: &a };
    assert_says(&read_reference(&full, Some(like)).expect_err("size"), &["full.exr", "reference", "8x5", "7x5"]);
}

#[test]
fn missing_roles_are_named_with_what_is_there() {
    let folder = tempfile::tempdir().expect("folder");
    let (a, b) = write_halves(folder.path());
    let path = |name: &str| folder.path().join(name);
    let features = write_file(&path("features.exr"), 3, &["albedo.R", "albedo.G", "albedo.B", "Z"]);
    assert_says(
        &error_of(&FrameFiles::halves(&features, &b)),
        &["features.exr", "no noisy colour of half a", "Noisy Image".to_lowercase().as_str(), "albedo (b,g,r)"],
    );
    let bare = write_file(&path("bare.exr"), 3, &["R", "G", "B"]);
    assert_says(
        &error_of(&FrameFiles::halves(&a, &bare)),
        &["bare.exr", "no denoised colour of half b", "denoised", "file of its own", "B,G,R"],
    );
    assert_says(&error_of(&FrameFiles::both_in_one(&a)), &["a.exr", "noisy colour of half a", "marked even, a"]);
    let halves = FrameFiles::halves(&a, &b);
    assert_says(&error_with(&halves, &["albedo=gloss"]), &["'gloss'", "albedo of half a", "normal (x,y,z)"]);
    assert_says(&error_with(&halves, &["normal-b=normal.X,normal.Y,normal.W"]), &["normal.W", "half b"]);
    assert_says(&error_with(&halves, &["denoised-a=visibility"]), &["3 channel(s) in layer 'visibility'"]);
    let no_reference = read_reference(&features, None).expect_err("no colour");
    assert_says(&no_reference, &["features.exr", "reference", "a.R,a.G,a.B"]);
    assert!(!no_reference.advice().contains("--role"), "roles are of halves: {}", no_reference.advice());
}

#[test]
fn halves_that_are_the_same_samples() {
    let folder = tempfile::tempdir().expect("folder");
    let (a, b) = write_halves(folder.path());
    let copy = folder.path().join("copy.exr");
    std::fs::copy(&a, &copy).expect("copied");
    assert_says(
        &error_of(&FrameFiles::halves(&a, &copy)),
        &["copy.exr", "a.exr", "independent", "same value in every pixel"],
    );
    assert_says(&error_of(&FrameFiles::halves(&a, &a)), &["a.exr", "noisy colour of half b"]);
    let full = write_file(&folder.path().join("full.exr"), 9, &["R", "G", "B"]);
    let files = FrameFiles::halves(&a, &b).with_denoised(Some(full.clone()), Some(full), None);
    assert_says(&error_of(&files), &["full.exr", "denoised colour of half b"]);
    // The same file twice: what else it lacks, and that it may be black, matters less.
    let bare = write_file(&folder.path().join("bare.exr"), 9, &["R", "G", "B"]);
    assert_says(&error_of(&FrameFiles::halves(&bare, &bare)), &["bare.exr", "same value in every pixel"]);
    let black = Image::zeros(3, H, W);
    let [black_a, black_b] = ["black_a.exr", "black_b.exr"].map(|name| {
        let path = folder.path().join(name);
        write_layers(&path, &[("", "RGB", &black), ("denoised", "RGB", &black)]);
        path
    });
    assert_says(&error_of(&FrameFiles::halves(&black_a, &black_a)), &["black_a.exr", "same value in every pixel"]);
    let fade = read_frame(&FrameFiles::halves(&black_a, &black_b), &RoleOverrides::none());
    assert!(fade.is_ok(), "sequences fade to black: {:?}", fade.err());
}

/// R, G and B apart, or one channel that is no colour by its name.
#[test]
fn channels_that_make_a_colour_are_proposed_and_the_proposal_works() {
    let folder = tempfile::tempdir().expect("folder");
    let file = |name: &str| folder.path().join(name);
    let part = |name, channels| Part { name, channels, ..Part::default() };
    let apart = [part("part0", &["R"][..]), part("part1", &["G"]), part("part2", &["B"])];
    let layers = [part("", &["red.R", "green.G", "blue.B"][..])];
    let single = [part("", &["G"][..])];
    for (parts, colour) in
        [(&apart[..], "part0.R,part1.G,part2.B"), (&layers, "red.R,green.G,blue.B"), (&single, "G,G,G")]
    {
        let files: Vec<_> = (1..5).map(|seed| write_parts(&file(&format!("{seed}.exr")), seed, parts)).collect();
        let given = FrameFiles::halves(&files[0], &files[1]).with_denoised(
            Some(files[2].clone()),
            Some(files[3].clone()),
            None,
        );
        let proposal = format!("radiance={colour}");
        assert_says(&error_of(&given), &["1.exr", &format!("perhaps --role '{proposal}'")]);
        let frame = read_frame(&given, &RoleOverrides::parse([proposal]).expect("an override")).expect("a frame");
        assert!(frame.sources.iter().all(|source| source.channels.join(",") == colour), "{:?}", frame.sources);
    }
}

/// A single-part header of 2x2 half-float pixels, to be bent.
fn header(width: i32, height: i32, sampling: i32, deep: bool) -> Vec<u8> {
    let mut bytes = vec![0x76, 0x2f, 0x31, 0x01, 2, if deep { 8 } else { 0 }, 0, 0];
    let mut attribute = |name: &str, kind: &str, value: &[u8]| {
        bytes.extend(name.bytes().chain([0]).chain(kind.bytes()).chain([0]));
        bytes.extend((value.len() as i32).to_le_bytes());
        bytes.extend(value);
    };
    let window: Vec<u8> = [0, 0, width - 1, height - 1].iter().flat_map(|v: &i32| v.to_le_bytes()).collect();
    let mut channels = Vec::new();
    for name in ["B", "G", "R"] {
        channels.extend(name.bytes().chain([0]));
        for field in [1, 0, sampling, sampling] {
            channels.extend(i32::to_le_bytes(field));
        }
    }
    channels.push(0);
    attribute("channels", "chlist", &channels);
    attribute("compression", "compression", &[0]);
    attribute("dataWindow", "box2i", &window);
    attribute("displayWindow", "box2i", &window);
    attribute("lineOrder", "lineOrder", &[0]);
    attribute("pixelAspectRatio", "float", &1.0f32.to_le_bytes());
    attribute("screenWindowCenter", "v2f", &[0; 8]);
    attribute("screenWindowWidth", "float", &1.0f32.to_le_bytes());
    if deep {
        attribute("type", "string", b"deepscanline");
        attribute("version", "int", &1i32.to_le_bytes());
        attribute("name", "string", b"deep");
        attribute("chunkCount", "int", &height.to_le_bytes());
        attribute("maxSamplesPerPixel", "int", &1i32.to_le_bytes());
    }
    bytes.push(0);
    bytes
}

fn write_bytes(folder: &Path, name: &str, bytes: &[u8]) -> PathBuf {
    let path = folder.join(name);
    std::fs::write(&path, bytes).expect("written");
    path
}

#[test]
fn headers_that_claim_too_much_are_refused_before_allocation() {
    let folder = tempfile::tempdir().expect("folder");
    for (width, height, said) in [
        (1_000_000_000, 1_000_000_000, "1000000000x1000000000"),
        (65_536, 65_536, "65536x65536"),
        (16_384, 16_384, "1610612736 bytes"),
        (i32::MAX, 1, "2147483647x1"),
    ] {
        let file = write_bytes(folder.path(), "claims.exr", &header(width, height, 1, false));
        let start = std::time::Instant::now();
        assert_says(&read_picture(&file, None).expect_err("claims"), &["claims.exr", "claims too much", said]);
        assert!(start.elapsed().as_secs() < 2, "refused from the header alone");
    }
}

/// Other readers take it for the header's end, and find the blocks elsewhere.
#[test]
fn an_attribute_without_a_type_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let read = |attribute: &[u8]| {
        let mut bytes = header(2, 2, 1, false);
        bytes.splice(8..8, attribute.iter().copied());
        let blocks = bytes.len() as u64 + 16;
        bytes.extend([blocks, blocks + 20].map(u64::to_le_bytes).concat());
        (0..2i32).for_each(|y| bytes.extend([&y.to_le_bytes()[..], &12i32.to_le_bytes(), &[0; 12]].concat()));
        read_picture(&write_bytes(folder.path(), "small.exr", &bytes), None)
    };
    assert!(read(b"typ\0string\0\0\0\0\0").is_ok());
    assert_says(&read(b"typ\0\0\0\0\0\0").expect_err("no type"), &["small.exr", "attribute typ without a type"]);
}

#[test]
fn deep_and_subsampled_data_are_refused_by_name() {
    let folder = tempfile::tempdir().expect("folder");
    let deep = write_bytes(folder.path(), "deep.exr", &header(2, 2, 1, true));
    assert_says(&read_picture(&deep, None).expect_err("deep"), &["deep.exr", "flat data", "deep data"]);
    let sampled = write_bytes(folder.path(), "chroma.exr", &header(2, 2, 2, false));
    assert_says(&read_picture(&sampled, None).expect_err("sampled"), &["chroma.exr", "every pixel sampled"]);
}

#[test]
fn a_picture_without_any_value_is_refused() {
    let folder = tempfile::tempdir().expect("folder");
    let (a, b) = write_halves(folder.path());
    let nan = folder.path().join("nan.exr");
    let picture = sspc_image::Image::filled(3, H, W, f32::NAN);
    sspc_testkit::exr_parts::write_picture(&nan, &picture);
    let overrides = format!("radiance-b={}", nan.display());
    assert_says(
        &error_with(&FrameFiles::halves(&a, &b), &[&overrides]),
        &["nan.exr", "only NaN or infinity", "half b"],
    );
}
