//! What the kernels ask of an instruction set.
//!
//! `exp2` and `log2_1p` are polynomials: relative error below 2.5e-7 for `exp2` on [-126, 127] and
//! below 4e-7 for `log2_1p` on [0, 1e37] (minimax fits on the reduced range; checked in the tests below).

/// Most lanes of any instruction set: rows are padded to a multiple of this.
pub const MAX_LANES: usize = 16;

/// A vector instruction set, as a token: a value exists only where the machine has the instructions, so
/// that arithmetic with it is safe. [`dispatch`](super::dispatch) hands it to a [`Kernel`](super::Kernel).
pub trait Simd: Copy + Send + Sync + 'static {
    /// A vector of f32 lanes.
    type F: Copy;
    /// Lanes of a vector.
    const LANES: usize;
    /// Vectors that the machine's registers hold.
    const REGISTERS: usize;
    /// Output channels that the convolution keeps in registers.
    const CONV_OUTPUTS: usize;

    /// The `LANES` values from `p` on.
    ///
    /// # Safety
    /// `p` must be valid for reads of `LANES` values; it need not be aligned.
    unsafe fn load_from(self, p: *const f32) -> Self::F;
    /// Writes the lanes from `p` on.
    ///
    /// # Safety
    /// `p` must be valid for writes of `LANES` values; it need not be aligned.
    unsafe fn store_to(self, p: *mut f32, v: Self::F);
    /// `v` in every lane.
    fn splat(self, v: f32) -> Self::F;
    /// a + b
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    /// a - b
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    /// a b
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    /// a / b
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    /// a b + c
    fn fma(self, a: Self::F, b: Self::F, c: Self::F) -> Self::F;
    /// The larger of a and b; b where a is NaN.
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// √a
    fn sqrt(self, a: Self::F) -> Self::F;
    /// Lanes of `a` where `x > 0`, zero elsewhere.
    fn where_positive(self, x: Self::F, a: Self::F) -> Self::F;
    /// |a| with the sign of `s`.
    fn copysign(self, a: Self::F, s: Self::F) -> Self::F;
    /// |a|
    fn abs(self, a: Self::F) -> Self::F;
    /// Sum of the lanes.
    fn sum(self, a: Self::F) -> f32;
    /// x rounded to a whole number.
    fn round(self, x: Self::F) -> Self::F;
    /// a 2^n for a whole n >= -126 and a result in f32's normal range.
    fn scale(self, a: Self::F, n: Self::F) -> Self::F;
    /// For u >= 1: (e, 2^-e) with u / 2^e in [1, 2).
    fn exponent(self, u: Self::F) -> (Self::F, Self::F);

    /// The first `LANES` of `values`.
    ///
    /// # Panics
    /// When there are fewer.
    #[inline(always)]
    fn load(self, values: &[f32]) -> Self::F {
        assert!(values.len() >= Self::LANES);
        // SAFETY: the slice holds LANES values.
        unsafe { self.load_from(values.as_ptr()) }
    }

    /// Writes the first `LANES` of `values`.
    ///
    /// # Panics
    /// When there are fewer.
    #[inline(always)]
    fn store(self, values: &mut [f32], v: Self::F) {
        assert!(values.len() >= Self::LANES);
        // SAFETY: the slice holds LANES values.
        unsafe { self.store_to(values.as_mut_ptr(), v) }
    }

    /// All of at most `LANES` values; the other lanes are zero.
    #[inline(always)]
    fn load_part(self, values: &[f32]) -> Self::F {
        if values.len() == Self::LANES {
            return self.load(values);
        }
        let mut padded = [0.0; MAX_LANES];
        padded[..values.len()].copy_from_slice(values);
        self.load(&padded)
    }

    /// Writes all of at most `LANES` values.
    #[inline(always)]
    fn store_part(self, values: &mut [f32], v: Self::F) {
        if values.len() == Self::LANES {
            return self.store(values, v);
        }
        let mut padded = [0.0; MAX_LANES];
        self.store(&mut padded, v);
        values.copy_from_slice(&padded[..values.len()]);
    }

    /// 0 in every lane.
    #[inline(always)]
    fn zero(self) -> Self::F {
        self.splat(0.0)
    }

    /// 2^x; arguments below -126 give 2^-126.
    #[inline(always)]
    fn exp2(self, x: Self::F) -> Self::F {
        self.exp2_each(&Exp2::times(1.0), [self.max(x, self.splat(-126.0))])[0]
    }

    /// A multiple of 2^x of several vectors, x from -126 on, step by step for all of them: one alone would be a chain in which each
    /// step waits for the one before.
    #[inline(always)]
    fn exp2_each<const N: usize>(self, multiple: &Exp2, mut x: [Self::F; N]) -> [Self::F; N] {
        let mut n = x;
        for (x, n) in x.iter_mut().zip(&mut n) {
            *n = self.round(*x);
            *x = self.sub(*x, *n);
        }
        let mut powers = in_one_chain(self, &multiple.0, &x);
        for (power, n) in powers.iter_mut().zip(n) {
            *power = self.scale(*power, n);
        }
        powers
    }

    /// log2(1 + x) for x >= 0, exact to the last bits near 0 as well.
    #[inline(always)]
    fn log2_1p(self, x: Self::F) -> Self::F {
        self.log2_1p_each([x])[0]
    }

    /// log2(1 + x) of several vectors.
    #[inline(always)]
    fn log2_1p_each<const N: usize>(self, mut x: [Self::F; N]) -> [Self::F; N] {
        let one = self.splat(1.0);
        // (1 + x) / 2^e in [sqrt(1/2), sqrt(2)).
        let root = self.splat(std::f32::consts::SQRT_2);
        let mut exponents = x;
        for (x, exponent) in x.iter_mut().zip(&mut exponents) {
            let (e, inverse) = self.exponent(self.fma(*x, root, root));
            // (1 + x) / 2^e - 1 without rounding 1 + x first.
            (*x, *exponent) = (self.fma(*x, inverse, self.sub(inverse, one)), e);
        }
        let mut logarithms = in_two_chains(self, &LOG2_1P, &x);
        for ((logarithm, t), e) in logarithms.iter_mut().zip(x).zip(exponents) {
            *logarithm = self.fma(t, *logarithm, e);
        }
        logarithms
    }
}

/// A multiple of 2^r on [-1/2, 1/2] as a polynomial, lowest power first.
pub struct Exp2([f32; 6]);

impl Exp2 {
    /// `factor` 2^r, minimax but for the factor, a power of two.
    pub const fn times(factor: f32) -> Self {
        const ONE: [f32; 6] = [1.0, 0.693_146_94, 0.240_221_2, 0.055_507_13, 0.009_675_541, 0.001_327_647];
        let [a, b, c, d, e, f] = ONE;
        Self([factor * a, factor * b, factor * c, factor * d, factor * e, factor * f])
    }
}

/// Minimax coefficients of log2(1 + t) / t on [sqrt(1/2) - 1, sqrt(2) - 1].
const LOG2_1P: [f32; 8] =
    [1.442_694_9, -0.721_352_8, 0.480_923_24, -0.360_239_62, 0.287_098_7, -0.248_876_88, 0.234_042_3, -0.145_811_51];

/// The polynomial of each vector by Horner's rule, which rounds least.
#[inline(always)]
fn in_one_chain<S: Simd, const N: usize>(s: S, coefficients: &[f32], x: &[S::F; N]) -> [S::F; N] {
    let mut values = [s.splat(coefficients[coefficients.len() - 1]); N];
    for &c in coefficients.iter().rev().skip(1) {
        for (value, x) in values.iter_mut().zip(x) {
            *value = s.fma(*value, *x, s.splat(c));
        }
    }
    values
}

/// The polynomial of each vector, even and odd powers by themselves: two short chains in the place of a long one. Of an even
/// number of coefficients.
#[inline(always)]
fn in_two_chains<S: Simd, const N: usize>(s: S, coefficients: &[f32], x: &[S::F; N]) -> [S::F; N] {
    let n = coefficients.len();
    let mut squares = *x;
    for square in &mut squares {
        *square = s.mul(*square, *square);
    }
    let (mut odd, mut even) = ([s.splat(coefficients[n - 1]); N], [s.splat(coefficients[n - 2]); N]);
    for i in (0..n - 2).rev().step_by(2) {
        for ((odd, even), square) in odd.iter_mut().zip(&mut even).zip(&squares) {
            *odd = s.fma(*odd, *square, s.splat(coefficients[i]));
            *even = s.fma(*even, *square, s.splat(coefficients[i - 1]));
        }
    }
    for ((odd, even), x) in odd.iter_mut().zip(&even).zip(x) {
        *odd = s.fma(*odd, *x, *even);
    }
    odd
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simd::{Isa, Kernel, dispatch};

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
        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> Vec<f32> {
            let mut out = vec![0.0; self.0.len()];
            for (x, out) in self.0.chunks_exact(S::LANES).zip(out.chunks_exact_mut(S::LANES)) {
                let y = match self.1 {
                    fn_kind::Kind::Exp2 => s.exp2(s.load(x)),
                    fn_kind::Kind::Log2OnePlus => s.log2_1p(s.load(x)),
                };
                s.store(out, y);
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
