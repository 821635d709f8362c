//! The library's C interface, as much of it as is needed: a device on the processor, and one filter at a time on memory
//! that outlives it. Names and signatures are those of `oidn.h` of version 2.

use libloading::Library;
use std::ffi::{CStr, c_char, c_int, c_void};
use std::mem::ManuallyDrop;
use std::path::Path;
use std::ptr::{NonNull, null, null_mut};

/// `OIDN_DEVICE_TYPE_CPU`.
const CPU: c_int = 1;
/// `OIDN_FORMAT_FLOAT3`.
const FLOAT3: c_int = 3;
/// `OIDN_ERROR_CANCELLED`.
const CANCELLED: c_int = 6;
/// Values of a pixel.
const CHANNELS: usize = 3;

type Handle = *mut c_void;
type Monitor = extern "C" fn(*mut c_void, f64) -> bool;

/// Why a file is not the library.
#[derive(Debug)]
pub enum NotOpened {
    /// The system's loader says so.
    Loader(String),
    /// A function is not there.
    Lacks(&'static str),
    /// It is an earlier version.
    Version(Option<c_int>),
}

/// Why a call failed.
#[derive(Debug, PartialEq, Eq)]
pub enum CallError {
    /// It was asked to stop.
    Cancelled,
    /// In the library's words.
    Message(String),
}

macro_rules! functions {
    ($($field:ident = $symbol:literal : fn($($argument:ty),*) $(-> $result:ty)?;)*) => {
        /// The functions of an opened library, which stays open.
        #[derive(Clone, Copy)]
        pub struct Functions {
            $($field: unsafe extern "C" fn($($argument),*) $(-> $result)?,)*
        }

        impl Functions {
            fn of(library: &Library) -> Result<Self, NotOpened> {
                Ok(Self { $($field: {
                    // SAFETY: the type is that of the function of this name in oidn.h, which has kept it through all of
                    // version 2. The pointer outlives `library` because the library is never closed (`Functions::open`).
                    let found = unsafe {
                        library.get::<unsafe extern "C" fn($($argument),*) $(-> $result)?>($symbol.as_bytes())
                    };
                    *found.map_err(|_| NotOpened::Lacks($symbol))?
                },)* })
            }
        }
    };
}

functions! {
    new_device = "oidnNewDevice": fn(c_int) -> Handle;
    set_device_int = "oidnSetDeviceInt": fn(Handle, *const c_char, c_int);
    set_device_bool = "oidnSetDeviceBool": fn(Handle, *const c_char, bool);
    get_device_int = "oidnGetDeviceInt": fn(Handle, *const c_char) -> c_int;
    commit_device = "oidnCommitDevice": fn(Handle);
    get_device_error = "oidnGetDeviceError": fn(Handle, *mut *const c_char) -> c_int;
    release_device = "oidnReleaseDevice": fn(Handle);
    new_filter = "oidnNewFilter": fn(Handle, *const c_char) -> Handle;
    set_image = "oidnSetSharedFilterImage":
        fn(Handle, *const c_char, *mut c_void, c_int, usize, usize, usize, usize, usize);
    set_filter_bool = "oidnSetFilterBool": fn(Handle, *const c_char, bool);
    set_filter_int = "oidnSetFilterInt": fn(Handle, *const c_char, c_int);
    set_monitor = "oidnSetFilterProgressMonitorFunction": fn(Handle, Option<Monitor>, *mut c_void);
    commit_filter = "oidnCommitFilter": fn(Handle);
    execute_filter = "oidnExecuteFilter": fn(Handle);
    release_filter = "oidnReleaseFilter": fn(Handle);
}

impl Functions {
    /// Opens a library, by its file or by a name that the system's loader knows.
    pub fn open(path: &Path) -> Result<Self, NotOpened> {
        // SAFETY: opening a library runs its initialisers. Which library that is the user decides, by naming it, by
        // installing it, or by the system's loader path, as for every plug-in; its initialisers ask nothing of the caller.
        let library = unsafe { open(path) }.map_err(|error| NotOpened::Loader(error.to_string()))?;
        // Threads of the library may run as long as the process does, so it is never closed.
        let library = ManuallyDrop::new(library);
        if !has(&library, c"oidnNewDevice") {
            return Err(NotOpened::Lacks("oidnNewDevice"));
        }
        if has(&library, c"oidnGetDevice1i") && !has(&library, c"oidnGetDeviceInt") {
            return Err(NotOpened::Version(version_of_1(&library)));
        }
        Self::of(&library)
    }
}

/// # Safety
/// The library's initialisers run, see [`Library::new`].
#[cfg(not(windows))]
unsafe fn open(path: &Path) -> Result<Library, libloading::Error> {
    // SAFETY: the caller's.
    unsafe { Library::new(path) }
}

/// # Safety
/// The library's initialisers run, see [`Library::new`].
#[cfg(windows)]
unsafe fn open(path: &Path) -> Result<Library, libloading::Error> {
    use libloading::os::windows::{LOAD_WITH_ALTERED_SEARCH_PATH, Library as Windows};
    // What the library needs lies beside it.
    let flags = if path.is_absolute() { LOAD_WITH_ALTERED_SEARCH_PATH } else { 0 };
    // SAFETY: the caller's.
    unsafe { Windows::load_with_flags(path, flags) }.map(Library::from)
}

fn has(library: &Library, name: &CStr) -> bool {
    // SAFETY: the pointer is neither called nor read, only looked for, so its type does not matter.
    unsafe { library.get::<*const c_void>(name.to_bytes_with_nul()) }.is_ok()
}

/// The version of a library before 2.0, as 10000 major + 100 minor + patch.
fn version_of_1(library: &Library) -> Option<c_int> {
    // SAFETY: these are the functions' types in version 1's oidn.h; a device is asked for its version and released.
    unsafe {
        let new = library.get::<unsafe extern "C" fn(c_int) -> Handle>(b"oidnNewDevice").ok()?;
        let get = library.get::<unsafe extern "C" fn(Handle, *const c_char) -> c_int>(b"oidnGetDevice1i").ok()?;
        let release = library.get::<unsafe extern "C" fn(Handle)>(b"oidnReleaseDevice").ok()?;
        let device = NonNull::new(new(CPU))?;
        let version = get(device.as_ptr(), c"version".as_ptr());
        release(device.as_ptr());
        Some(version)
    }
}

/// A device: the processor, with a number of threads.
pub struct Device {
    functions: Functions,
    handle: NonNull<c_void>,
}

/// One run of a filter over pictures of one size, three interleaved values a pixel.
pub struct Job<'a> {
    /// Pictures that are read, by their names in the interface.
    pub inputs: Vec<(&'static CStr, &'a [f32])>,
    /// The picture that is written.
    pub output: &'a mut [f32],
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Settings that are true; others are left at false, which is their default.
    pub on: Vec<&'static CStr>,
    /// Settings with a number.
    pub numbers: Vec<(&'static CStr, c_int)>,
    /// Whether to stop; asked now and then, on the calling thread or one of the library's.
    pub asked_to_stop: fn() -> bool,
}

impl Device {
    /// Starts the processor as a device.
    pub fn start(functions: Functions, threads: usize) -> Result<Self, CallError> {
        // SAFETY: no argument is a pointer.
        let handle = NonNull::new(unsafe { (functions.new_device)(CPU) });
        let Some(handle) = handle else {
            return Err(error_of(&functions, null_mut()).unwrap_or(CallError::Message("no device".into())));
        };
        let device = Self { functions, handle };
        let threads = c_int::try_from(threads).unwrap_or(c_int::MAX);
        // SAFETY: the handle is a live device, names end in NUL, and settings come before the commit as is asked for.
        unsafe {
            (functions.set_device_int)(handle.as_ptr(), c"numThreads".as_ptr(), threads);
            // Threads stay where the system puts them: this program's own want the same cores in turn.
            (functions.set_device_bool)(handle.as_ptr(), c"setAffinity".as_ptr(), false);
            (functions.commit_device)(handle.as_ptr());
        }
        device.check().map(|()| device)
    }

    /// The library's version as 10000 major + 100 minor + patch.
    pub fn version(&self) -> c_int {
        // SAFETY: the handle is a live device, and the name ends in NUL.
        unsafe { (self.functions.get_device_int)(self.handle.as_ptr(), c"version".as_ptr()) }
    }

    /// Runs a filter.
    ///
    /// # Panics
    /// When a picture has not the size that is claimed.
    pub fn run(&self, job: Job) -> Result<(), CallError> {
        let Job { inputs, output, width, height, on, numbers, asked_to_stop } = job;
        let values = width * height * CHANNELS;
        assert!(inputs.iter().all(|(_, picture)| picture.len() == values) && output.len() == values, "sizes");
        let functions = &self.functions;
        // SAFETY: the handle is a live device, and the name ends in NUL.
        let filter = NonNull::new(unsafe { (functions.new_filter)(self.handle.as_ptr(), c"RT".as_ptr()) });
        let Some(filter) = filter else { return Err(self.failure()) };
        let mut outcome = Ok(());
        // SAFETY: the filter is live until it is released at the end, and does its work inside these calls. Every picture
        // is a slice of width x height x 3 values as the assertion has it, borrowed for longer than this function; inputs
        // are only read, and the output is borrowed exclusively. `asked_to_stop` lives as long as the filter, and the
        // monitor reads it as what it is.
        unsafe {
            let image = |name: &CStr, values: *mut c_void| {
                (functions.set_image)(filter.as_ptr(), name.as_ptr(), values, FLOAT3, width, height, 0, 0, 0);
            };
            for (name, picture) in &inputs {
                image(name, picture.as_ptr().cast_mut().cast());
            }
            image(c"output", output.as_mut_ptr().cast());
            for name in on {
                (functions.set_filter_bool)(filter.as_ptr(), name.as_ptr(), true);
            }
            for (name, number) in numbers {
                (functions.set_filter_int)(filter.as_ptr(), name.as_ptr(), number);
            }
            let asked: *const fn() -> bool = &asked_to_stop;
            (functions.set_monitor)(filter.as_ptr(), Some(monitor), asked.cast_mut().cast());
            (functions.commit_filter)(filter.as_ptr());
            outcome = outcome.and(self.check());
            if outcome.is_ok() {
                (functions.execute_filter)(filter.as_ptr());
                outcome = self.check();
            }
            (functions.release_filter)(filter.as_ptr());
        }
        outcome
    }

    fn check(&self) -> Result<(), CallError> {
        error_of(&self.functions, self.handle.as_ptr()).map_or(Ok(()), Err)
    }

    fn failure(&self) -> CallError {
        error_of(&self.functions, self.handle.as_ptr()).unwrap_or(CallError::Message("no filter".into()))
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        // SAFETY: the handle is a live device, which nothing else holds.
        unsafe { (self.functions.release_device)(self.handle.as_ptr()) }
    }
}

/// Says whether to go on.
extern "C" fn monitor(asked_to_stop: *mut c_void, _done: f64) -> bool {
    // SAFETY: `Device::run` gives the address of such a function pointer, which lives as long as the filter.
    let asked_to_stop = unsafe { *asked_to_stop.cast_const().cast::<fn() -> bool>() };
    !asked_to_stop()
}

/// The first error since it was last asked for; of no device, that of the thread.
fn error_of(functions: &Functions, device: Handle) -> Option<CallError> {
    let mut message: *const c_char = null();
    // SAFETY: the handle is a live device or null, as the interface allows; the message is a C string that the library keeps
    // at least until its next call on this thread, and it is copied before that.
    unsafe {
        let code = (functions.get_device_error)(device, &mut message);
        let text = || match message.is_null() {
            true => format!("error {code}"),
            false => CStr::from_ptr(message).to_string_lossy().into_owned(),
        };
        match code {
            0 => None,
            CANCELLED => Some(CallError::Cancelled),
            _ => Some(CallError::Message(text())),
        }
    }
}
