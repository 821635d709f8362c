//! Which instruction sets there are, and which one runs.

/// Instruction sets that the kernels exist in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// 16 lanes, needs AVX-512F.
    Avx512,
    /// 8 lanes, needs AVX2 and FMA.
    Avx2,
    /// 8 lanes in pairs of registers, on 64-bit Arm.
    Neon,
    /// 8 lanes of plain f32 arithmetic, on any machine.
    Portable,
}

impl Isa {
    /// The instruction sets this machine can run, widest first.
    pub fn available() -> Vec<Isa> {
        [Isa::Avx512, Isa::Avx2, Isa::Neon, Isa::Portable].into_iter().filter(|isa| isa.is_available()).collect()
    }

    /// Whether this machine can run it.
    pub fn is_available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => is_x86_feature_detected!("avx512f"),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            Isa::Neon => cfg!(target_arch = "aarch64"),
            Isa::Portable => true,
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Avx512 | Isa::Avx2 => false,
        }
    }

    /// The widest instruction set of this machine.
    pub fn best() -> Isa {
        Isa::available()[0]
    }

    /// The instruction set that the environment variable [`ISA_VARIABLE`] names (avx512, avx2, neon, portable); without it
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
            Isa::Neon => "neon",
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
