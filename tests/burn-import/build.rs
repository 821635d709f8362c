//! Writes the graphs and lets burn-onnx turn them into Rust.

#[path = "src/model.rs"]
mod model;

use std::path::PathBuf;

fn main() {
    let folder = PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo names a folder"));
    let model = model::model();
    let graphs = [("network.onnx", sspc_onnx::write_network(&model)), ("image.onnx", sspc_onnx::write_image(&model))];
    let mut import = burn_onnx::ModelGen::new();
    for (name, bytes) in graphs {
        let path = folder.join(name);
        std::fs::write(&path, bytes).expect("a graph");
        import.input(path.to_str().expect("a path in UTF-8"));
    }
    import.out_dir("graphs/").run_from_script();
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rerun-if-changed=src/model.rs");
}
