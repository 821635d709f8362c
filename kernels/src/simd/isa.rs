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
        #[cfg(target_arch = "aarch64")]
        sets.push(Isa::Neon);
        sets.push(Isa::Portable);
        sets
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
