//! What the picture is made of: the paper's mean of halves, or ours.

/// What the picture is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Composition {
    /// ½ (μ̂^a + μ̂^b), as it is (the paper).
    MeanOfHalves,
    /// The correction of the full buffer's z, as far as the halves' judgement of each other goes.
    JudgedFullBuffer,
}

impl Composition {
    /// Whether blocks without noise are left as the denoiser made them: not by the paper.
    pub fn skips_still_blocks(self) -> bool {
        self == Composition::JudgedFullBuffer
    }
}
