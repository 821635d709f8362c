//! One generic SIMD body, four instruction sets, one dispatcher.
//!
//! A kernel is written once over [`Simd`]; [`dispatch`] runs it under an instruction set, by default the widest
//! that the machine has. Every instruction set can be forced for tests through [`Isa`].

/// Methods of [`Simd`] from vectors to a vector that are one intrinsic or a few.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! operations {
    ($vector:ty: $($name:ident($($argument:ident),+) $body:expr;)+) => {$(
        #[inline(always)]
        fn $name(self, $($argument: $vector),+) -> $vector {
            // SAFETY: by the token, the machine has the instructions; they touch no memory.
            unsafe { $body }
        }
    )+};
}

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod dispatch;
mod isa;
#[cfg(target_arch = "aarch64")]
mod neon;
mod portable;
mod vector;

pub use dispatch::{Kernel, dispatch};
pub use isa::{ISA_VARIABLE, Isa, UnknownIsa};
pub use vector::{Exp2, MAX_LANES, Simd};
