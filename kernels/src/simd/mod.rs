//! One generic SIMD body, three instruction sets, one dispatcher.
//!
//! A kernel is written once over [`Simd`]; [`dispatch`] runs it under the widest instruction set
//! that the machine has. Every instruction set can be forced for tests through [`Isa`].
//!
//! `exp2` and `log2_1p` are polynomials: relative error below 2.5e-7 for `exp2` on [-126, 127] and
//! below 4e-7 for `log2_1p` on [0, 1e37] (minimax fits on the reduced range; checked in the tests below).

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
mod portable;

pub use portable::Portable;

/// Instruction sets that the kernels exist in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// 16 lanes, needs AVX-512F.
    Avx512,
    /// 8 lanes, needs AVX2 and FMA.
    Avx2,
    /// 8 lanes of plain f32 arithmetic, on any machine.
    Portable,
}

impl Isa {
    /// The instruction sets this machine can run, widest first.
    pub fn available() -> Vec<Isa> {
        let mut sets = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") {
                sets.push(Isa::Avx512);
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                sets.push(Isa::Avx2);
            }
        }
        sets.push(Isa::Portable);
        sets
    }

    /// The widest instruction set of this machine.
    pub fn best() -> Isa {
        Isa::available()[0]
    }

    /// The instruction set that the environment variable [`ISA_VARIABLE`] names (avx512, avx2, portable); without it
    /// [`Isa::best`].
    ///
    /// # Errors
    /// When the variable names none that this machine has.
    pub fn from_env() -> Result<Isa, UnknownIsa> {
        match std::env::var_os(ISA_VARIABLE) {
            None => Ok(Isa::best()),
            Some(name) => Isa::named(&name.to_string_lossy()),
        }
    }

    /// The instruction set of this machine that has this name.
    ///
    /// # Errors
    /// When there is none.
    pub fn named(name: &str) -> Result<Isa, UnknownIsa> {
        let found = Isa::available().into_iter().find(|isa| isa.name() == name);
        found.ok_or_else(|| UnknownIsa { name: name.chars().take(LONGEST_NAME).collect() })
    }

    /// The name in reports and in [`ISA_VARIABLE`].
    pub fn name(self) -> &'static str {
        match self {
            Isa::Avx512 => "avx512",
            Isa::Avx2 => "avx2",
            Isa::Portable => "portable",
        }
    }
}

/// The environment variable that forces an instruction set.
pub const ISA_VARIABLE: &str = "SSPC_ISA";
/// Longest part of an unknown name that is repeated to the user.
const LONGEST_NAME: usize = 40;

/// A name that is no instruction set of this machine.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownIsa {
    name: String,
}

impl std::fmt::Display for UnknownIsa {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let names: Vec<&str> = Isa::available().into_iter().map(Isa::name).collect();
        write!(out, "{ISA_VARIABLE}: expected {}, found {:?}", names.join(", "), self.name)
    }
}

impl std::error::Error for UnknownIsa {}

/// Most lanes of any instruction set: rows are padded to a multiple of this.
pub const MAX_LANES: usize = 16;

/// A vector of f32 lanes and the arithmetic that the kernels need.
///
/// # Safety
/// Every method must only be called on a machine that has the instruction set, which
/// [`dispatch`] guarantees; pointers must be valid for `LANES` values.
pub trait Simd: Copy + Send + Sync + 'static {
    type F: Copy;
    const LANES: usize;
    /// Vector registers of the machine.
    const REGISTERS: usize;
    /// Output channels and row vectors that the convolution keeps in registers.
    const CONV_OUTPUTS: usize;

    unsafe fn load(p: *const f32) -> Self::F;
    unsafe fn store(p: *mut f32, v: Self::F);
    unsafe fn splat(v: f32) -> Self::F;
    unsafe fn add(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn sub(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn mul(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn div(a: Self::F, b: Self::F) -> Self::F;
    /// a * b + c
    unsafe fn fma(a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    unsafe fn max(a: Self::F, b: Self::F) -> Self::F;
    unsafe fn sqrt(a: Self::F) -> Self::F;
    /// Lanes of `a` where `x > 0`, zero elsewhere.
    unsafe fn where_positive(x: Self::F, a: Self::F) -> Self::F;
    /// |a| with the sign of `s`.
    unsafe fn copysign(a: Self::F, s: Self::F) -> Self::F;
    unsafe fn abs(a: Self::F) -> Self::F;
    unsafe fn sum(a: Self::F) -> f32;
    /// x rounded to a whole number.
    unsafe fn round(x: Self::F) -> Self::F;
    /// a 2^n for a whole n >= -126 and a result in f32's normal range.
    unsafe fn scale(a: Self::F, n: Self::F) -> Self::F;
    /// For u >= 1: (e, 2^-e) with u / 2^e in [1, 2).
    unsafe fn exponent(u: Self::F) -> (Self::F, Self::F);

    unsafe fn zero() -> Self::F {
        unsafe { Self::splat(0.0) }
    }

    /// 2^x; arguments below -126 give 2^-126.
    #[inline(always)]
    unsafe fn exp2(x: Self::F) -> Self::F {
        unsafe {
            let x = Self::max(x, Self::splat(-126.0));
            let n = Self::round(x);
            Self::scale(polynomial::<Self>(&EXP2, Self::sub(x, n)), n)
        }
    }

    /// log2(1 + x) for x >= 0, exact to the last bits near 0 as well.
    #[inline(always)]
    unsafe fn log2_1p(x: Self::F) -> Self::F {
        unsafe {
            let one = Self::splat(1.0);
            // (1 + x) / 2^e in [sqrt(1/2), sqrt(2)).
            let root = Self::splat(std::f32::consts::SQRT_2);
            let (e, inverse) = Self::exponent(Self::fma(x, root, root));
            // (1 + x) / 2^e - 1 without rounding 1 + x first.
            let t = Self::fma(x, inverse, Self::sub(inverse, one));
            Self::fma(t, polynomial::<Self>(&LOG2_1P, t), e)
        }
    }
}

/// Minimax coefficients of 2^r on [-1/2, 1/2], lowest power first.
const EXP2: [f32; 6] = [1.0, 0.693_146_94, 0.240_221_2, 0.055_507_13, 0.009_675_541, 0.001_327_647];
/// Minimax coefficients of log2(1 + t) / t on [sqrt(1/2) - 1, sqrt(2) - 1].
const LOG2_1P: [f32; 8] =
    [1.442_694_9, -0.721_352_8, 0.480_923_24, -0.360_239_62, 0.287_098_7, -0.248_876_88, 0.234_042_3, -0.145_811_51];

#[inline(always)]
unsafe fn polynomial<S: Simd>(coefficients: &[f32], x: S::F) -> S::F {
    unsafe {
        let mut value = S::splat(coefficients[coefficients.len() - 1]);
        for &c in coefficients.iter().rev().skip(1) {
            value = S::fma(value, x, S::splat(c));
        }
        value
    }
}

/// A computation written over [`Simd`].
pub trait Kernel {
    type Output;
    /// # Safety
    /// Called by [`dispatch`] only, on a machine that has `S`.
    unsafe fn run<S: Simd>(self) -> Self::Output;
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
        // SAFETY: plain arithmetic, on any machine.
        _ => unsafe { kernel.run::<Portable>() },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Map<'a>(&'a [f32], fn_kind::Kind);
    mod fn_kind {
        #[derive(Clone, Copy)]
        pub enum Kind {
            Exp2,
            Log2OnePlus,
        }
    }
    impl Kernel for Map<'_> {
        type Output = Vec<f32>;
        unsafe fn run<S: Simd>(self) -> Vec<f32> {
            let mut out = vec![0.0; self.0.len()];
            for i in (0..self.0.len()).step_by(S::LANES) {
                unsafe {
                    let x = S::load(self.0.as_ptr().add(i));
                    let y = match self.1 {
                        fn_kind::Kind::Exp2 => S::exp2(x),
                        fn_kind::Kind::Log2OnePlus => S::log2_1p(x),
                    };
                    S::store(out.as_mut_ptr().add(i), y);
                }
            }
            out
        }
    }

    fn worst_relative(x: &[f32], got: &[f32], truth: impl Fn(f64) -> f64) -> f64 {
        x.iter()
            .zip(got)
            .map(|(&x, &got)| {
                let t = truth(f64::from(x));
                (f64::from(got) - t).abs() / t.abs().max(f64::MIN_POSITIVE)
            })
            .fold(0.0, |worst: f64, e| if e.is_nan() { f64::INFINITY } else { worst.max(e) })
    }

    #[test]
    fn an_instruction_set_is_known_by_its_name_alone() {
        for isa in Isa::available() {
            assert_eq!(Isa::named(isa.name()), Ok(isa));
        }
        for name in ["", "avx", "AVX2", "portable ", "sse2\n"] {
            let error = Isa::named(name).expect_err("no such set").to_string();
            assert!(error.starts_with("SSPC_ISA: expected ") && error.contains("portable, found"), "{error}");
            assert!(!error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn exp2_and_log2_keep_their_stated_error() {
        let n = 16 * 4096;
        let exponents: Vec<f32> = (0..n).map(|i| -126.0 + 253.0 * i as f32 / n as f32).collect();
        let arguments: Vec<f32> = (0..n).map(|i| 10f32.powf(-12.0 + 49.0 * i as f32 / n as f32)).collect();
        for isa in Isa::available() {
            let e = dispatch(isa, Map(&exponents, fn_kind::Kind::Exp2));
            assert!(worst_relative(&exponents, &e, f64::exp2) < 2.5e-7, "{}", isa.name());
            let l = dispatch(isa, Map(&arguments, fn_kind::Kind::Log2OnePlus));
            let worst = worst_relative(&arguments, &l, |x| x.ln_1p() / std::f64::consts::LN_2);
            assert!(worst < 4e-7, "{}: {worst}", isa.name());
        }
    }
}
