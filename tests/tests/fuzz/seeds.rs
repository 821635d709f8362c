//! The seeds' maker: `cargo test --release --workspace --test fuzz -- --ignored` writes `fuzz/seeds` anew. The files
//! `dwaa.exr` and `dwab.exr` come from OpenEXR's own library (see fuzz/README.md): this project's cannot write them.

use exr::compression::Compression;
use sspc_core::rng::Rng;
use sspc_core::start;
use sspc_kernels::network::Shape;
use sspc_kernels::parameters::Form;
use sspc_onnx::{Contract, Model, write_image, write_network};
use sspc_testkit::exr_parts::{HALF, Part, write_parts};
use std::path::{Path, PathBuf};

/// All pictures have this size, so that any two make a frame: more rows than a block of ZIP has.
const SIZE: (usize, usize) = (4, 20);

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../fuzz/seeds")
}

#[test]
#[ignore = "writes into the source tree"]
fn write_seeds() {
    let folder = folder();
    pictures(&folder.join("exr"));
    let other = Part { channels: HALF, size: SIZE, half: true, ..Part::default() };
    write_parts(&folder.join("other-half.exr"), 2, &[other]);
    models(&folder.join("model"));
    texts(&folder.join("text"));
}

fn pictures(folder: &Path) {
    let write = |name: &str, parts: &[Part]| write_parts(&folder.join(name).with_extension("exr"), 1, parts);
    for (name, compression, half) in [
        ("none", Compression::Uncompressed, true),
        ("rle", Compression::RLE, true),
        ("zips", Compression::ZIP1, false),
        ("zip", Compression::ZIP16, true),
        ("piz", Compression::PIZ, true),
        ("pxr24", Compression::PXR24, false),
        ("b44", Compression::B44, true),
        ("b44a", Compression::B44A, true),
    ] {
        write(name, &[Part { channels: HALF, size: SIZE, half, compression, ..Part::default() }]);
    }
    write("tiles", &[Part { channels: HALF, size: SIZE, tiles: Some((3, 8)), ..Part::default() }]);
    let cycles = |pass: &'static str, channels: &'static [&'static str]| Part {
        name: pass,
        channels,
        size: SIZE,
        half: true,
        ..Part::default()
    };
    let parts = [
        cycles("V.Combined", &["V.Combined.R", "V.Combined.G", "V.Combined.B", "V.Combined.A"]),
        cycles("V.Noisy Image", &["V.Noisy Image.R", "V.Noisy Image.G", "V.Noisy Image.B"]),
        cycles("V.Denoising Albedo", &["V.Denoising Albedo.R", "V.Denoising Albedo.G", "V.Denoising Albedo.B"]),
        cycles("V.Depth", &["V.Depth.Z"]),
    ];
    write("parts", &parts);
    let names = ["even", "odd", "denoisedA", "denoisedB", "albedo"];
    let channels: Vec<String> = names.iter().flat_map(|n| ["R", "G", "B"].map(|c| format!("{n}.{c}"))).collect();
    let channels: Vec<&str> = channels.iter().map(String::as_str).collect();
    write("both-halves", &[Part { channels: &channels, size: SIZE, half: true, ..Part::default() }]);
    let reference = ["R", "G", "B", "a.R", "a.G", "a.B", "b.R", "b.G", "b.B"];
    write("reference", &[Part { channels: &reference, size: SIZE, half: true, ..Part::default() }]);
}

fn models(folder: &Path) {
    for (form, name) in [(Form::Paper, "paper"), (Form::Gated, "gated")] {
        let mut contract = Contract::new(form);
        // The smallest network keeps the file to a few kilobytes, most of them contract and operators.
        contract.shape = Shape { hidden: 1, layers: 2, outputs: form.parameters() };
        contract.window_radius = 1;
        contract.frames = vec!["shot/a.1001.exr".into()];
        contract.extra.insert("note".into(), "a seed".into());
        let weights = start::paper(contract.shape, &mut Rng::new(1)).weights;
        let model = Model::new(contract, weights).expect("a model");
        std::fs::write(folder.join(format!("{name}-network.onnx")), write_network(&model)).expect("written");
        std::fs::write(folder.join(format!("{name}-image.onnx")), write_image(&model)).expect("written");
    }
}

fn texts(folder: &Path) {
    for (name, text) in [
        ("frames-range", "1001-1020"),
        ("frames-step", "1-100x5"),
        ("frames-list", "1001, 1005-1010,7-7x3,0"),
        ("frames-many", "0-9999"),
        ("frames-far", "0-999999999x999999999"),
        ("pattern-hashes", "shot/a.####.exr"),
        ("pattern-percent", "100%/a.%04d.exr"),
        ("pattern-bare", "%d"),
        ("role-layer", "albedo=diffuse_color"),
        ("role-channels", "normal-a=N.x,N.y,N.z"),
        ("role-file", "denoised-full=full.exr"),
        ("role-file-layer", "albedo-a=features_a.exr:albedo"),
        ("role-none", "visibility=none"),
    ] {
        std::fs::write(folder.join(name), text).expect("written");
    }
}
