//! Writes `capi/include/sspc.h` from the sources of the C interface; its test fails where the header is stale:
//!
//!     cargo run --manifest-path capi/header/Cargo.toml
//!     cargo test --manifest-path capi/header/Cargo.toml
#![forbid(unsafe_code)]

use cbindgen::{Builder, Config};
use std::path::Path;

/// Modules of the interface, in the header's order.
const SOURCES: [&str; 4] = ["types.rs", "outcome.rs", "model.rs", "correct.rs"];

fn main() {
    std::fs::write(path(), header()).expect("the header can be written");
}

fn path() -> impl AsRef<Path> {
    concat!(env!("CARGO_MANIFEST_DIR"), "/../include/sspc.h")
}

fn header() -> String {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = Config::from_file(own.join("cbindgen.toml")).expect("cbindgen.toml");
    let builder = SOURCES
        .iter()
        .fold(Builder::new().with_config(config), |builder, source| builder.with_src(own.join("../src").join(source)));
    let mut header = Vec::new();
    builder.generate().expect("sources of C interfaces").write(&mut header);
    String::from_utf8(header).expect("UTF-8")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_is_that_of_the_sources() {
        let found = std::fs::read_to_string(path()).expect("capi/include/sspc.h");
        assert!(found == header(), "stale: cargo run --manifest-path capi/header/Cargo.toml");
    }
}
