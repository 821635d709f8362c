//! C programs, compiled with the header against the shared library under the sanitizers of `cc`, and run.

use crate::files::{Files, model};
use sspc_image::{Frame, Image};
use sspc_kernels::parameters::Form;
use sspc_testkit::c_programs::cc;
use sspc_testkit::exr_parts::write_picture;
use sspc_testkit::frames::whole_sample;
use sspc_testkit::skips::skipped;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const SANITIZERS: &str = "-fsanitize=address,undefined";

/// Where the tests lie, and what was built for them.
fn libraries() -> PathBuf {
    let test = std::env::current_exe().expect("a path");
    test.parent().expect("a folder").to_path_buf()
}

/// Compiles a program of this folder, under the sanitizers where `cc` has them; `None`, said aloud, without `cc`.
fn compiled(folder: &Path, source: &str) -> Option<PathBuf> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let libraries = libraries();
    let program = folder.join("program");
    let rpath = format!("-Wl,-rpath,{}", libraries.display());
    let [source_file, include] = [source, "include"].map(|path| own.join(path));
    let compile = |more: &[&str]| {
        let flags = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-g"].iter().chain(more).map(OsStr::new);
        let files = [source_file.as_os_str(), OsStr::new("-I"), include.as_os_str(), OsStr::new("-L")];
        let linked = [
            libraries.as_os_str(),
            OsStr::new("-Wl,--as-needed"),
            OsStr::new("-lsspc"),
            OsStr::new("-lm"),
            OsStr::new("-ldl"),
            OsStr::new(&rpath),
        ];
        cc(source, flags.chain(files).chain(linked).chain([OsStr::new("-o"), program.as_os_str()]))
    };
    let checked = compile(&[SANITIZERS, "-fno-sanitize-recover=all"])?;
    if !checked.status.success() {
        let plain = compile(&[])?;
        assert!(plain.status.success(), "{}", text(&plain.stderr));
        skipped("sanitizers", &text(&checked.stderr));
    }
    Some(program)
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Cargo's own search path would find the library of an earlier `cargo build` first.
fn run(program: &Path, arguments: &[&Path]) -> Output {
    Command::new(program).args(arguments).env_remove("LD_LIBRARY_PATH").output().expect("the program")
}

/// Writes a picture as little-endian PFM, the bottom row first.
fn write_pfm(path: &Path, picture: &Image) {
    let mut bytes = format!("PF\n{} {}\n-1.0\n", picture.width(), picture.height()).into_bytes();
    for (y, x) in (0..picture.height()).rev().flat_map(|y| (0..picture.width()).map(move |x| (y, x))) {
        (0..3).for_each(|c| bytes.extend(picture.at(c, y, x).to_le_bytes()));
    }
    fs::write(path, bytes).expect("a file");
}

#[test]
fn the_example_gives_the_program_s_picture() {
    let files = Files::write();
    let Some(program) = compiled(files.folder.path(), "examples/correct.c") else { return };
    let path = |name: &str| files.folder.path().join(name);
    let Frame { a, b, denoised, .. } = whole_sample();
    let denoised = denoised.expect("z of the full buffer");
    let pictures = [&a.radiance, &b.radiance, &a.denoised, &b.denoised, &denoised];
    for (name, picture) in ["a", "b", "za", "zb", "z"].into_iter().zip(pictures) {
        write_pfm(&path(name).with_extension("pfm"), picture);
        write_picture(&path(name).with_extension("exr"), picture);
    }

    let model = files.model(&model(Form::Gated, 1));
    let inputs = ["out.pfm", "a.pfm", "b.pfm", "za.pfm", "zb.pfm", "z.pfm"].map(path);
    let arguments: Vec<&Path> = [model.as_path()].into_iter().chain(inputs.iter().map(PathBuf::as_path)).collect();
    let done = run(&program, &arguments);
    assert!(done.status.success(), "{}", text(&done.stderr));
    assert!(text(&done.stderr).contains("100 %") && text(&done.stdout).starts_with("estimated relL2"));

    let (expected, _) = files.run(&model, &["--denoised".to_string(), path("z.exr").display().to_string()]);
    write_pfm(&path("expected.pfm"), &expected);
    let bytes = |name: &str| fs::read(path(name)).expect("a file");
    assert!(bytes("out.pfm") == bytes("expected.pfm"));
    assert!(expected != denoised, "something was corrected");

    // A frame that it makes up, and a model that is none.
    assert!(run(&program, &[&model, &path("own.pfm")]).status.success() && bytes("own.pfm").len() > 3 * 4 * 192 * 256);
    let refused = run(&program, &[&path("a.pfm"), &path("own.pfm")]);
    assert_eq!(refused.status.code(), Some(3), "{}", text(&refused.stderr));
    assert!(text(&refused.stderr).contains("not an ONNX file"));
}

#[test]
fn the_header_is_c_plus_plus_too() {
    let header = Path::new(env!("CARGO_MANIFEST_DIR")).join("include/sspc.h");
    let flags =
        ["-x", "c++", "-std=c++11", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only"].map(OsStr::new);
    let Some(done) = cc("C++", flags.into_iter().chain([header.as_os_str()])) else { return };
    let said = text(&done.stderr);
    if said.contains("cc1plus") {
        return skipped("C++", &said);
    }
    assert!(done.status.success(), "{said}");
}

#[test]
fn nothing_lives_on_when_the_library_is_closed() {
    let files = Files::write();
    let Some(program) = compiled(files.folder.path(), "tests/c_interface/reload.c") else { return };
    let done = run(&program, &[&libraries().join("libsspc.so"), &files.model(&model(Form::Gated, 1))]);
    assert!(done.status.success(), "{:?} {}", done.status, text(&done.stderr));
}

#[test]
fn misuse_is_refused_and_nothing_leaks() {
    let files = Files::write();
    let Some(program) = compiled(files.folder.path(), "tests/c_interface/misuse.c") else { return };
    let done = run(&program, &[&files.model(&model(Form::Gated, 1))]);
    assert!(done.status.success(), "{}", text(&done.stderr));
}
