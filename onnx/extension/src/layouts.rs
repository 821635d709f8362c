//! Types of onnxruntime's C interface and the places of its functions, as much of it as the operator needs: those of
//! `onnxruntime_c_api.h`, version 17 of the interface (onnxruntime 1.17), which later versions only add to.

use std::ffi::{c_char, c_int, c_void};
use std::mem::{offset_of, size_of};

/// Types of which only pointers are known.
macro_rules! opaque {
    ($($(#[$doc:meta])* $name:ident),*) => {
        $($(#[$doc])* #[repr(C)] pub struct $name { _never_made: [u8; 0] })*
    };
}
opaque!(
    /// `OrtStatus`: an error; null is none.
    Status,
    /// `OrtSessionOptions`.
    SessionOptions,
    /// `OrtCustomOpDomain`.
    Domain,
    /// `OrtValue`: a tensor.
    Value,
    /// `OrtTensorTypeAndShapeInfo`.
    Shape,
    /// `OrtKernelInfo`: a node's attributes.
    KernelInfo,
    /// `OrtKernelContext`: a call's inputs and outputs.
    KernelContext
);

/// `OrtApiBase`.
#[repr(C)]
pub struct ApiBase {
    pub(crate) get_api: unsafe extern "system" fn(version: u32) -> *const Api,
    pub(crate) get_version_string: unsafe extern "system" fn() -> *const c_char,
}

/// `OrtApi`: a table of functions, of which these have a name here.
#[repr(C)]
pub struct Api {
    pub(crate) create_status: unsafe extern "system" fn(code: c_int, text: *const c_char) -> *mut Status,
    _to_2: [usize; 1],
    pub(crate) get_error_message: unsafe extern "system" fn(*const Status) -> *const c_char,
    _to_26: [usize; 23],
    pub(crate) create_custom_op_domain:
        unsafe extern "system" fn(name: *const c_char, out: *mut *mut Domain) -> *mut Status,
    pub(crate) custom_op_domain_add: unsafe extern "system" fn(*mut Domain, *const CustomOp) -> *mut Status,
    pub(crate) add_custom_op_domain: unsafe extern "system" fn(*mut SessionOptions, *mut Domain) -> *mut Status,
    _to_51: [usize; 22],
    pub(crate) get_tensor_mutable_data: unsafe extern "system" fn(*mut Value, out: *mut *mut c_void) -> *mut Status,
    _to_61: [usize; 9],
    pub(crate) get_dimensions_count: unsafe extern "system" fn(*const Shape, out: *mut usize) -> *mut Status,
    pub(crate) get_dimensions: unsafe extern "system" fn(*const Shape, sizes: *mut i64, count: usize) -> *mut Status,
    _to_65: [usize; 2],
    pub(crate) get_tensor_type_and_shape: unsafe extern "system" fn(*const Value, out: *mut *mut Shape) -> *mut Status,
    _to_86: [usize; 20],
    pub(crate) get_attribute_int64:
        unsafe extern "system" fn(*const KernelInfo, name: *const c_char, out: *mut i64) -> *mut Status,
    _to_90: [usize; 3],
    pub(crate) get_input:
        unsafe extern "system" fn(*const KernelContext, index: usize, out: *mut *const Value) -> *mut Status,
    pub(crate) get_output: unsafe extern "system" fn(
        *mut KernelContext,
        index: usize,
        sizes: *const i64,
        count: usize,
        out: *mut *mut Value,
    ) -> *mut Status,
    _to_93: [usize; 1],
    pub(crate) release_status: unsafe extern "system" fn(*mut Status),
    _to_99: [usize; 5],
    pub(crate) release_shape: unsafe extern "system" fn(*mut Shape),
    _to_274: [usize; 174],
    pub(crate) parallel_for: unsafe extern "system" fn(
        *const KernelContext,
        work: unsafe extern "C" fn(data: *mut c_void, index: usize),
        total: usize,
        batches: usize,
        data: *mut c_void,
    ) -> *mut Status,
}

/// Whether a function stands at its place in the table.
macro_rules! placed {
    ($($name:ident $place:literal),*) => {
        $(const _: () = assert!(offset_of!(Api, $name) == $place * size_of::<usize>());)*
    };
}
placed!(create_status 0, get_error_message 2, create_custom_op_domain 26, custom_op_domain_add 27);
placed!(add_custom_op_domain 28, get_tensor_mutable_data 51, get_dimensions_count 61, get_dimensions 62);
placed!(get_tensor_type_and_shape 65, get_attribute_int64 86, get_input 90, get_output 91, release_status 93);
placed!(release_shape 99, parallel_for 274);

/// A function of [`CustomOp`] that is left out.
pub(crate) type Absent = Option<extern "system" fn()>;

/// `OrtCustomOp` of version 17.
#[repr(C)]
pub struct CustomOp {
    pub(crate) version: u32,
    pub(crate) create_kernel: Absent,
    pub(crate) get_name: extern "system" fn(*const CustomOp) -> *const c_char,
    pub(crate) get_execution_provider: extern "system" fn(*const CustomOp) -> *const c_char,
    pub(crate) get_input_type: extern "system" fn(*const CustomOp, usize) -> c_int,
    pub(crate) get_input_count: extern "system" fn(*const CustomOp) -> usize,
    pub(crate) get_output_type: extern "system" fn(*const CustomOp, usize) -> c_int,
    pub(crate) get_output_count: extern "system" fn(*const CustomOp) -> usize,
    pub(crate) compute: Absent,
    pub(crate) destroy: unsafe extern "system" fn(*mut c_void),
    pub(crate) get_input_characteristic: extern "system" fn(*const CustomOp, usize) -> c_int,
    pub(crate) get_output_characteristic: extern "system" fn(*const CustomOp, usize) -> c_int,
    pub(crate) get_input_memory: extern "system" fn(*const CustomOp, usize) -> c_int,
    /// Arity and homogeneity of variadic inputs and outputs: there are none.
    pub(crate) variadic: [Absent; 4],
    pub(crate) create_kernel_v2:
        unsafe extern "system" fn(*const CustomOp, *const Api, *const KernelInfo, *mut *mut c_void) -> *mut Status,
    pub(crate) compute_v2: unsafe extern "system" fn(*mut c_void, *mut KernelContext) -> *mut Status,
    pub(crate) infer_shape: Absent,
    pub(crate) versions: [Absent; 2],
}
