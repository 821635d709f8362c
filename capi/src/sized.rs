//! Structures that may grow at their ends. The first field is the size of the structure as its caller knows it: what a
//! caller of older days does not know is zero, and what a caller of later days asks for must be.

use crate::outcome::nonsense;
use crate::types::{SspcFrame, SspcModelInfo, SspcOptions, SspcPicture};
use sspc_cli::Failure;
use std::mem::{MaybeUninit, offset_of};
use std::ptr;
use std::slice;

/// A structure that begins with its size.
///
/// # Safety
/// It is `repr(C)`, its first field is a `usize`, and all bytes zero are a value.
pub unsafe trait Growing: Copy {
    /// What makes one.
    const MADE_BY: &str;
    /// Its size in the first version of the interface.
    const FIRST_SIZE: usize;
}

macro_rules! growing {
    ($structure:ty, $made_by:expr, $first_last:ident: $of_first:ty $(, since then up to $last:ident: $of:ty)?) => {
        // SAFETY: repr(C), begins with `struct_size: usize`, and holds numbers, pointers and optional functions.
        unsafe impl Growing for $structure {
            const MADE_BY: &str = $made_by;
            const FIRST_SIZE: usize = offset_of!($structure, $first_last) + size_of::<$of_first>();
        }
        // In padding at the end a later field would not show in the size.
        const _: () = {
            #[allow(unused_mut, unused_assignments, reason = "of those that grew")]
            let mut size = <$structure as Growing>::FIRST_SIZE;
            $(size = offset_of!($structure, $last) + size_of::<$of>();)?
            assert!(size == size_of::<$structure>());
        };
    };
}

growing!(SspcFrame, "sspc_frame", denoised_more_count: usize, since then up to samples_b: f64);
growing!(SspcOptions, "sspc_options", user: *mut ());
growing!(SspcPicture, "sspc_picture", warnings: u32);
growing!(SspcModelInfo, "sspc_model_info", visibility: u32);

/// What the caller's structure says, in as far as the library knows it.
///
/// # Errors
/// NULL, a size that no version has, or bytes beyond what is known that are not zero.
///
/// # Safety
/// `from` is NULL or points to as many bytes as its first field says, or to that field alone where it says too little.
pub unsafe fn read<T: Growing>(name: &str, from: *const T) -> Result<T, Failure> {
    let made_by = format!("make it by {}()", T::MADE_BY);
    if from.is_null() {
        return Err(nonsense(name, "a structure", "NULL", &made_by));
    }
    // SAFETY: the first field is there.
    let size = unsafe { from.cast::<usize>().read_unaligned() };
    if size < T::FIRST_SIZE {
        let expected = format!("at least {}", T::FIRST_SIZE);
        return Err(nonsense(&format!("{name}.struct_size"), &expected, size, &made_by));
    }
    let known = size.min(size_of::<T>());
    // SAFETY: the caller's structure has `size` bytes.
    let beyond = unsafe { slice::from_raw_parts(from.cast::<u8>().add(known), size - known) };
    if beyond.iter().any(|byte| *byte != 0) {
        let expected = format!("nothing set beyond the {known} bytes that this library knows");
        return Err(nonsense(name, &expected, "something", "use the library of the header's version, or a later one"));
    }
    let mut value = MaybeUninit::<T>::zeroed();
    // SAFETY: both have `known` bytes; all of the value is set, to the caller's bytes and zeros.
    unsafe {
        ptr::copy_nonoverlapping(from.cast::<u8>(), value.as_mut_ptr().cast(), known);
        Ok(value.assume_init())
    }
}

/// Gives the caller's structure, which was [`read`], what it knows of `value`.
///
/// # Safety
/// As [`read`], which succeeded.
pub unsafe fn write<T: Growing>(value: &T, to: *mut T) {
    // SAFETY: the caller's structure has at least as many bytes as its size says.
    unsafe {
        let known = to.cast::<usize>().read_unaligned().min(size_of::<T>());
        ptr::copy_nonoverlapping(ptr::from_ref(value).cast::<u8>(), to.cast(), known);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The options of a later version: one field more.
    #[repr(C)]
    struct Later {
        known: SspcOptions,
        more: u64,
    }

    fn later(more: u64) -> Later {
        let struct_size = size_of::<Later>();
        Later { known: SspcOptions { struct_size, threads: 3, ..SspcOptions::DEFAULT }, more }
    }

    #[test]
    fn what_the_library_does_not_know_must_be_zero() {
        let (unset, set) = (later(0), later(1));
        // SAFETY: both have the size that they say.
        let [unset, set] = [&unset, &set].map(|later| unsafe { read("options", &raw const later.known) });
        assert_eq!(unset.expect("options").threads, 3);
        assert!(set.expect_err("a field that is not known").message.contains("beyond the 32 bytes"));
    }

    #[test]
    fn sizes_of_no_version_are_refused() {
        for size in [0, 8, size_of::<SspcOptions>() - 1] {
            let options = SspcOptions { struct_size: size, ..later(0).known };
            // SAFETY: the first field is there.
            let message = unsafe { read("options", &options) }.expect_err("too small").message;
            assert_eq!(message, format!("options.struct_size: expected at least 32, found {size}"));
        }
        // SAFETY: NULL is allowed.
        assert!(unsafe { read::<SspcOptions>("options", ptr::null()) }.is_err());
    }

    #[test]
    fn no_more_is_written_than_the_caller_has() {
        let mut to = later(7);
        to.known.struct_size = size_of::<SspcOptions>();
        let value = SspcOptions { threads: 9, ..to.known };
        // SAFETY: it has the size that it says.
        unsafe { write(&value, &raw mut to.known) };
        assert_eq!((to.known.threads, to.more), (9, 7));
    }
}
