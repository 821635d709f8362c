//! Models: loaded, described, freed.

use crate::outcome::{nonsense, outcome};
use crate::sized;
use crate::types::{SSPC_ABI_VERSION, SspcModelInfo};
use sspc_arrays::model::{of_bytes, of_file};
use sspc_cli::{Code, Failure};
use std::ffi::{CStr, c_char, c_int, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::slice;

/// A fitted model. Any number of threads may use one at the same time.
pub struct SspcModel {
    pub(crate) model: sspc_onnx::Model,
}

/// The interface's version that the library has; see SSPC_ABI_VERSION.
#[unsafe(no_mangle)]
pub extern "C" fn sspc_abi_version() -> u32 {
    SSPC_ABI_VERSION
}

/// The version of the programs that the library belongs to, e.g. "0.1.0". Pictures may differ between versions.
#[unsafe(no_mangle)]
pub extern "C" fn sspc_version() -> *const c_char {
    const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
        Ok(version) => version,
        Err(_) => panic!("a version without NUL"),
    };
    VERSION.as_ptr()
}

/// Reads a model's file, `model.onnx` as `sspc-train fit` or `export` wrote it, whose path is UTF-8; gives NULL where that
/// fails.
///
/// # Safety
/// `path` is a string, and `model` a place for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sspc_model_load(path: *const c_char, model: *mut *mut SspcModel) -> c_int {
    let load = || {
        if path.is_null() {
            return Err(nonsense("path", "a string", "NULL", "give the path of a model.onnx"));
        }
        // SAFETY: a string, by the caller's promise.
        let path = unsafe { CStr::from_ptr(path) };
        let path = path.to_str().map_err(|_| nonsense("path", "UTF-8", format!("{path:?}"), ""))?;
        of_file(Path::new(path))
    };
    // SAFETY: the caller's promise.
    unsafe { give(model, load) }
}

/// The same of the bytes of such a file, which are not needed afterwards.
///
/// # Safety
/// `bytes` are so many, and `model` is a place for a pointer.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sspc_model_read(bytes: *const c_void, count: usize, model: *mut *mut SspcModel) -> c_int {
    let load = || {
        if bytes.is_null() {
            return Err(nonsense("bytes", "the bytes of a model", "NULL", "give what a model.onnx holds"));
        }
        if isize::try_from(count).is_err() {
            return Err(nonsense("count", "the number of bytes", count, ""));
        }
        // SAFETY: so many bytes, by the caller's promise.
        of_bytes(unsafe { slice::from_raw_parts(bytes.cast(), count) })
    };
    // SAFETY: the caller's promise.
    unsafe { give(model, load) }
}

/// # Safety
/// `place` is NULL or a place for a pointer.
unsafe fn give(place: *mut *mut SspcModel, load: impl FnOnce() -> Result<sspc_onnx::Model, Failure>) -> c_int {
    outcome(|| {
        if place.is_null() {
            return Err(nonsense("model", "a place for a pointer", "NULL", ""));
        }
        // SAFETY: a place for a pointer, by the caller's promise.
        unsafe { place.write(std::ptr::null_mut()) };
        let model = Box::new(SspcModel { model: load()? });
        // SAFETY: the same.
        unsafe { place.write(Box::into_raw(model)) };
        Ok(String::new())
    })
}

/// Frees a model; NULL is left alone.
///
/// # Safety
/// It was made by this library, is freed once, and no call uses it meanwhile or later.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sspc_model_free(model: *mut SspcModel) {
    if !model.is_null() {
        // SAFETY: made by `give`, and freed once, by the caller's promise.
        let model = unsafe { Box::from_raw(model) };
        let _ = catch_unwind(AssertUnwindSafe(|| drop(model)));
    }
}

/// Says what a model is.
///
/// # Safety
/// The model is none that was freed, and `info` was made by `sspc_model_info`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn sspc_model_describe(model: *const SspcModel, info: *mut SspcModelInfo) -> c_int {
    outcome(|| {
        // SAFETY: the caller's promise.
        let (contract, known) = unsafe { (&present(model)?.contract, sized::read("info", info)?) };
        let features = contract.features;
        let count = |count: usize| u32::try_from(count).unwrap_or(u32::MAX);
        let said = SspcModelInfo {
            contract_version: contract.version(),
            networks: count(contract.networks),
            extra_frames: count(contract.extra_frames),
            albedo: features.albedo.into(),
            normal: features.normal.into(),
            visibility: features.visibility.into(),
            ..known
        };
        // SAFETY: it was read.
        unsafe { sized::write(&said, info) };
        Ok(String::new())
    })
}

/// # Safety
/// The model is NULL or lives for as long as is asked for.
pub(crate) unsafe fn present<'a>(model: *const SspcModel) -> Result<&'a sspc_onnx::Model, Failure> {
    // SAFETY: the caller's promise.
    let model = unsafe { model.as_ref() };
    let missing = || Failure::new(Code::Arguments, "model: expected a model, found NULL", "load one first");
    model.map(|model| &model.model).ok_or_else(missing)
}
