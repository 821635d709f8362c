//! onnxruntime's C interface, as much of it as the operator needs, and the library's entry point. No panic leaves it.

use crate::layouts::{Api, ApiBase, CustomOp, Domain, KernelContext, KernelInfo, SessionOptions, Status, Value};
use crate::operator::{INPUT_COUNT, Job, Operator, Tensor};
use sspc_onnx::{DOMAIN, POST_CORRECTION, RADIUS_ATTRIBUTE};
use std::any::Any;
use std::ffi::{CStr, CString, c_char, c_int, c_void};
use std::marker::PhantomData;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::ptr::{null, null_mut};
use std::slice;
use std::sync::{Mutex, PoisonError};

/// Version of the interface that is asked for: the first with `KernelContext_ParallelFor`.
const API_VERSION: u32 = 17;
/// The onnxruntime that has it.
const LEAST_ONNXRUNTIME: &str = "1.17";

/// `ORT_FAIL` and `ORT_INVALID_ARGUMENT`.
const FAIL: c_int = 1;
const INVALID_ARGUMENT: c_int = 2;
/// `ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT`.
const FLOAT: c_int = 1;
/// `INPUT_OUTPUT_REQUIRED` of `OrtCustomOpInputOutputCharacteristic`.
const REQUIRED: c_int = 0;
/// `OrtMemTypeDefault`.
const DEFAULT_MEMORY: c_int = 0;

static CUSTOM_OP: CustomOp = CustomOp {
    version: API_VERSION,
    create_kernel: None,
    get_name,
    get_execution_provider,
    get_input_type: get_type,
    get_input_count,
    get_output_type: get_type,
    get_output_count,
    compute: None,
    destroy,
    get_input_characteristic: characteristic,
    get_output_characteristic: characteristic,
    get_input_memory,
    variadic: [None; 4],
    create_kernel_v2: create_kernel,
    compute_v2: compute,
    infer_shape: None,
    versions: [None; 2],
};

extern "system" fn get_name(_: *const CustomOp) -> *const c_char {
    const NAME: &CStr = c"PostCorrection";
    const _: () = assert!(NAME.to_bytes().len() == POST_CORRECTION.len());
    NAME.as_ptr()
}

/// Null: processors.
extern "system" fn get_execution_provider(_: *const CustomOp) -> *const c_char {
    null()
}

extern "system" fn get_type(_: *const CustomOp, _: usize) -> c_int {
    FLOAT
}

extern "system" fn get_input_count(_: *const CustomOp) -> usize {
    INPUT_COUNT
}

extern "system" fn get_output_count(_: *const CustomOp) -> usize {
    1
}

extern "system" fn characteristic(_: *const CustomOp, _: usize) -> c_int {
    REQUIRED
}

extern "system" fn get_input_memory(_: *const CustomOp, _: usize) -> c_int {
    DEFAULT_MEMORY
}

/// What onnxruntime keeps for a node.
struct Kernel {
    api: &'static Api,
    operator: Operator,
}

/// Adds the domain `sspc` with the operator `PostCorrection` to a session's options: what onnxruntime's
/// `RegisterCustomOpsLibrary` calls. Null, or the reason why not.
///
/// # Safety
/// Both pointers are onnxruntime's own.
#[unsafe(no_mangle)]
#[allow(non_snake_case)]
pub unsafe extern "system" fn RegisterCustomOps(options: *mut SessionOptions, base: *const ApiBase) -> *mut Status {
    // SAFETY: the caller's promise.
    let Some(base) = (unsafe { base.as_ref() }) else { return null_mut() };
    // SAFETY: functions of onnxruntime's, called as they ask for; its table lives as long as its library, and that of the
    // version has all functions of [`Api`].
    let (api, version) = unsafe { ((base.get_api)(API_VERSION).as_ref(), (base.get_version_string)()) };
    let Some(api) = api else {
        // SAFETY: the string that it gave.
        let version = unsafe { text(version) };
        let reason = format!("sspc: expected onnxruntime {LEAST_ONNXRUNTIME} or later, found {version}");
        // SAFETY: every version gives the first one's table, which begins with this function.
        return unsafe {
            match (base.get_api)(1) {
                first if first.is_null() => null_mut(),
                first => (&raw const (*first).create_status).read()(FAIL, c_text(&reason).as_ptr()),
            }
        };
    };
    api.outcome(INVALID_ARGUMENT, || {
        // SAFETY: the options are the caller's, the domain is onnxruntime's, and the operator lives as long as the library.
        unsafe { api.result((api.add_custom_op_domain)(options, domain(api)?)) }
    })
}

/// A domain, and the table of the onnxruntime that made it.
struct Made(*const Api, *mut Domain);

// SAFETY: the domain is not changed once it is made, and onnxruntime reads it from any thread.
unsafe impl Send for Made {}

/// The domain of an onnxruntime, made once: sessions point to it, so that it is never released.
fn domain(api: &Api) -> Result<*mut Domain, String> {
    static ALL: Mutex<Vec<Made>> = Mutex::new(Vec::new());
    let mut all = ALL.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(Made(_, domain)) = all.iter().find(|made| made.0 == std::ptr::from_ref(api)) {
        return Ok(*domain);
    }
    let mut domain = null_mut();
    // SAFETY: the name is a string of C, and the operator lives as long as the library.
    unsafe {
        api.result((api.create_custom_op_domain)(c_text(DOMAIN).as_ptr(), &raw mut domain))?;
        api.result((api.custom_op_domain_add)(domain, &raw const CUSTOM_OP))?;
    }
    all.push(Made(api, domain));
    Ok(domain)
}

/// `CreateKernelV2`: a node's operator.
unsafe extern "system" fn create_kernel(
    _: *const CustomOp,
    api: *const Api,
    info: *const KernelInfo,
    kernel: *mut *mut c_void,
) -> *mut Status {
    // SAFETY: onnxruntime's table, which lives as long as its library.
    let api: &'static Api = unsafe { &*api };
    api.outcome(INVALID_ARGUMENT, || {
        let mut radius = 0;
        // SAFETY: the node's own attributes, a string of C, and where the value goes.
        unsafe {
            let name = c_text(RADIUS_ATTRIBUTE);
            api.result((api.get_attribute_int64)(info, name.as_ptr(), &raw mut radius))
                .map_err(|reason| format!("{RADIUS_ATTRIBUTE}: {reason}"))?;
        }
        let made = Box::new(Kernel { api, operator: Operator::new(radius)? });
        // SAFETY: where the kernel is wanted; [`destroy`] gets it back.
        unsafe { kernel.write(Box::into_raw(made).cast()) };
        Ok(())
    })
}

/// `KernelDestroy`.
unsafe extern "system" fn destroy(kernel: *mut c_void) {
    if !kernel.is_null() {
        // SAFETY: it is from [`create_kernel`], and nobody uses it any more.
        drop(unsafe { Box::from_raw(kernel.cast::<Kernel>()) });
    }
}

/// `KernelComputeV2`.
unsafe extern "system" fn compute(kernel: *mut c_void, context: *mut KernelContext) -> *mut Status {
    // SAFETY: it is from [`create_kernel`].
    let kernel = unsafe { &*kernel.cast::<Kernel>() };
    kernel.api.outcome(INVALID_ARGUMENT, || {
        let call = Call { api: kernel.api, context, lifetime: PhantomData };
        let inputs = [call.input(0)?, call.input(1)?, call.input(2)?];
        let job = Job::new(&kernel.operator, &inputs)?;
        let out = call.output(&job.output_shape())?;
        call.for_each(job.parts(out), |part| job.compute(part))
    })
}

/// A call of the operator: its tensors live as long as it.
struct Call<'a> {
    api: &'a Api,
    context: *mut KernelContext,
    lifetime: PhantomData<&'a mut KernelContext>,
}

impl<'a> Call<'a> {
    fn input(&self, index: usize) -> Result<Tensor<'a>, String> {
        let Self { api, context, .. } = self;
        let mut value = null();
        // SAFETY: the call's context, and where the value goes.
        unsafe { api.result((api.get_input)(*context, index, &raw mut value))? };
        if value.is_null() {
            return Err(format!("input {index}: expected a tensor, found none"));
        }
        let shape = api.shape(value)?;
        let count = shape.iter().try_fold(1usize, |count, &size| count.checked_mul(size));
        let count = count.ok_or_else(|| format!("input {index}: {shape:?} is too large"))?;
        let mut data = null_mut();
        // SAFETY: the value is a tensor; its data are only read.
        unsafe { api.result((api.get_tensor_mutable_data)(value.cast_mut(), &raw mut data))? };
        let values = match count {
            0 => &[][..],
            _ if data.is_null() => return Err(format!("input {index}: expected {count} values, found none")),
            // SAFETY: a dense tensor of f32, as `get_type` asks for, of this shape, which lives as long as the call and
            // which nobody changes meanwhile: outputs have memory of their own.
            _ => unsafe { slice::from_raw_parts(data.cast::<f32>(), count) },
        };
        Ok(Tensor { shape, values })
    }

    /// The call's output; asked for once.
    fn output(&self, shape: &[usize]) -> Result<&'a mut [f32], String> {
        let Self { api, context, .. } = self;
        let sizes: Vec<i64> = shape.iter().map(|&size| size as i64).collect();
        let (mut value, mut data) = (null_mut(), null_mut());
        // SAFETY: the call's context, as many sizes as it is told, and where values go.
        unsafe {
            api.result((api.get_output)(*context, 0, sizes.as_ptr(), sizes.len(), &raw mut value))?;
            if value.is_null() {
                return Err("the output cannot be had".into());
            }
            api.result((api.get_tensor_mutable_data)(value, &raw mut data))?;
        }
        match shape.iter().product() {
            0 => Ok(&mut []),
            _ if data.is_null() => Err("the output has no memory".into()),
            // SAFETY: a tensor of f32 of this shape, the call's own, which only this slice reaches. All values are written
            // before anyone reads them; whatever lies there is some f32.
            count => Ok(unsafe { slice::from_raw_parts_mut(data.cast::<f32>(), count) }),
        }
    }

    /// Does the work for each item, on the session's threads.
    fn for_each<T: Send, F: Fn(T) + Sync>(&self, items: Vec<T>, work: F) -> Result<(), String> {
        let items: Vec<Mutex<Option<T>>> = items.into_iter().map(|item| Mutex::new(Some(item))).collect();
        let fault = Mutex::new(None);
        let one = |index: usize| {
            let done = catch_unwind(AssertUnwindSafe(|| {
                let item = items[index].lock().unwrap_or_else(PoisonError::into_inner).take();
                item.into_iter().for_each(&work);
            }));
            if let Err(panic) = done {
                *fault.lock().unwrap_or_else(PoisonError::into_inner) = Some(words(&*panic));
            }
        };
        self.parallel(items.len(), &one)?;
        match fault.into_inner().unwrap_or_else(PoisonError::into_inner) {
            Some(fault) => Err(fault),
            None => Ok(()),
        }
    }

    /// Calls `one`, which must not panic, with 0 .. `count`.
    fn parallel<F: Fn(usize) + Sync>(&self, count: usize, one: &F) -> Result<(), String> {
        unsafe extern "C" fn call<F: Fn(usize) + Sync>(data: *mut c_void, index: usize) {
            // SAFETY: the closure below, which any thread may call; it is there until `parallel_for` returns.
            unsafe { (*data.cast::<F>())(index) };
        }
        let Self { api, context, .. } = self;
        let data = std::ptr::from_ref(one).cast_mut().cast();
        // SAFETY: the call's context; it returns when all indices are done.
        unsafe { api.result((api.parallel_for)(*context, call::<F>, count, 0, data)) }
    }
}

impl Api {
    /// Does the work of a call of onnxruntime's: null, or its failure as a status.
    fn outcome(&self, code: c_int, work: impl FnOnce() -> Result<(), String>) -> *mut Status {
        match catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|panic| Err(words(&*panic))) {
            Ok(()) => null_mut(),
            // SAFETY: a code of onnxruntime's and a string of C, which it copies.
            Err(reason) => unsafe { (self.create_status)(code, c_text(&format!("sspc: {reason}")).as_ptr()) },
        }
    }

    /// What a status says; it is released.
    ///
    /// # Safety
    /// It is null, or a status of this onnxruntime's that nobody else releases.
    unsafe fn result(&self, status: *mut Status) -> Result<(), String> {
        if status.is_null() {
            return Ok(());
        }
        // SAFETY: the caller's promise; the text is copied before it goes with the status.
        Err(unsafe {
            let reason = text((self.get_error_message)(status));
            (self.release_status)(status);
            reason
        })
    }

    /// Sizes of a tensor's dimensions.
    fn shape(&self, value: *const Value) -> Result<Vec<usize>, String> {
        let mut shape = null_mut();
        // SAFETY: the value is a tensor of the call at hand; the shape is released once, and has as many sizes as it says.
        let sizes = unsafe {
            self.result((self.get_tensor_type_and_shape)(value, &raw mut shape))?;
            let sizes = (|| {
                let mut count = 0;
                self.result((self.get_dimensions_count)(shape, &raw mut count))?;
                let mut sizes = vec![0i64; count];
                self.result((self.get_dimensions)(shape, sizes.as_mut_ptr(), count))?;
                Ok::<_, String>(sizes)
            })();
            (self.release_shape)(shape);
            sizes?
        };
        let size = |size: &i64| usize::try_from(*size).map_err(|_| format!("a dimension of size {size}"));
        sizes.iter().map(size).collect()
    }
}

/// # Safety
/// Null or a string of C.
unsafe fn text(text: *const c_char) -> String {
    if text.is_null() {
        return "nothing".into();
    }
    // SAFETY: the caller's promise.
    unsafe { CStr::from_ptr(text) }.to_string_lossy().into_owned()
}

fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', "\u{fffd}")).unwrap_or_default()
}

fn words(panic: &(dyn Any + Send)) -> String {
    let what = panic.downcast_ref::<String>().map(String::as_str).or_else(|| panic.downcast_ref::<&str>().copied());
    format!("a fault of the library: {}", what.unwrap_or("it says nothing"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Gives the text as the status, so that tests can read it.
    unsafe extern "system" fn create_status(_: c_int, text: *const c_char) -> *mut Status {
        // SAFETY: the string of the caller.
        unsafe { CStr::from_ptr(text) }.to_owned().into_raw().cast()
    }

    /// The table of a first version: shorter than [`Api`].
    #[repr(C)]
    struct Old {
        create_status: unsafe extern "system" fn(c_int, *const c_char) -> *mut Status,
    }

    unsafe extern "system" fn old_api(version: u32) -> *const Api {
        static OLD: Old = Old { create_status };
        if version <= 16 { (&raw const OLD).cast() } else { null() }
    }

    unsafe extern "system" fn no_api(_: u32) -> *const Api {
        null()
    }

    unsafe extern "system" fn old_version() -> *const c_char {
        c"1.16.3".as_ptr()
    }

    #[test]
    fn an_onnxruntime_that_is_too_old_is_told_so() {
        let base = ApiBase { get_api: old_api, get_version_string: old_version };
        // SAFETY: the options are not looked at.
        let status = unsafe { RegisterCustomOps(null_mut(), &raw const base) };
        // SAFETY: `create_status` made it.
        let said = unsafe { CString::from_raw(status.cast()) };
        assert_eq!(said.to_str(), Ok("sspc: expected onnxruntime 1.17 or later, found 1.16.3"));
        let base = ApiBase { get_api: no_api, get_version_string: old_version };
        // SAFETY: as above.
        unsafe { assert!(RegisterCustomOps(null_mut(), &raw const base).is_null()) };
        // SAFETY: nothing is read.
        unsafe { assert!(RegisterCustomOps(null_mut(), null()).is_null()) };
    }

    #[test]
    fn panics_are_words() {
        let panic = catch_unwind(|| panic!("of {} rows", 7)).expect_err("it panics");
        assert_eq!(words(&*panic), "a fault of the library: of 7 rows");
    }

    #[test]
    fn the_name_is_the_graphs() {
        // SAFETY: the operator's own name.
        assert_eq!(unsafe { CStr::from_ptr(get_name(null())) }.to_str(), Ok(POST_CORRECTION));
    }
}
