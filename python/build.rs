//! On macOS the symbols of the interpreter are looked up when the module is loaded.

fn main() {
    pyo3_build_config::add_extension_module_link_args();
}
