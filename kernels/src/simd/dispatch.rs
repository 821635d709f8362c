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
    match isa {
        #[cfg(target_arch = "x86_64")]
        Isa::Avx512 => {
            assert!(is_x86_feature_detected!("avx512f"), "this machine has no AVX-512F");
            // SAFETY: the feature was checked on the line above.
            unsafe { avx512::run(kernel) }
        }
        #[cfg(target_arch = "x86_64")]
        Isa::Avx2 => {
            assert!(
                is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
                "this machine has no AVX2 with FMA"
            );
            // SAFETY: the features were checked on the lines above.
            unsafe { avx2::run(kernel) }
        }
        #[cfg(target_arch = "aarch64")]
        Isa::Neon => kernel.run(neon::Neon),
        Isa::Portable => kernel.run(portable::Portable),
        #[cfg(not(target_arch = "x86_64"))]
        Isa::Avx512 | Isa::Avx2 => panic!("this machine has no {}", isa.name()),
        #[cfg(not(target_arch = "aarch64"))]
        Isa::Neon => panic!("this machine has no {}", isa.name()),
    }
}
