//! Runs a kernel under an instruction set.

#[cfg(target_arch = "aarch64")]
use super::neon;
use super::{Isa, Simd, portable};
#[cfg(target_arch = "x86_64")]
use super::{avx2, avx512};

/// A computation written over [`Simd`].
pub trait Kernel {
    /// What it computes.
    type Output;
    /// Computes it with the instruction set of `s`. This and all that it calls must be
    /// `#[inline(always)]`: what stays a function of its own is not compiled for the instruction set.
    fn run<S: Simd>(self, s: S) -> Self::Output;
}

/// Runs a kernel under `isa`.
///
/// # Panics
/// When the machine lacks the instruction set.
pub fn dispatch<K: Kernel>(isa: Isa, kernel: K) -> K::Output {
    assert!(isa.is_available(), "this machine has no {}", isa.name());
    match isa {
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the machine has it, as was checked above.
        Isa::Avx512 => unsafe { avx512::run(kernel) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the machine has it, as was checked above.
        Isa::Avx2 => unsafe { avx2::run(kernel) },
        #[cfg(target_arch = "aarch64")]
        Isa::Neon => kernel.run(neon::Neon),
        // Portable: the others are not available.
        _ => kernel.run(portable::Portable),
    }
}
