//! The program is handed on alone, to farm nodes and engines: without line tables it is a fifth of the size. Names of
//! functions stay, for profiles and backtraces.

fn main() {
    if std::env::var("CARGO_CFG_TARGET_OS").is_ok_and(|os| os == "linux") {
        println!("cargo::rustc-link-arg-bins=-Wl,--strip-debug");
    }
    println!("cargo::rerun-if-changed=build.rs");
}
