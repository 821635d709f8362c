//! What all frames of a run share.

use super::arguments::RunArguments;
use crate::engine::Engine;
use sspc_cli::Denoising;
use sspc_cli::output::Output;
use sspc_cli::shot::Shot;
use sspc_frames::RoleOverrides;
use sspc_kernels::simd::Isa;

/// What all frames of a run share.
pub struct Shared<'a> {
    /// As given.
    pub arguments: &'a RunArguments,
    /// Roles that the user named.
    pub overrides: &'a RoleOverrides,
    /// What makes denoised pictures that the files do not hold.
    pub denoising: &'a Denoising<'a>,
    /// The model, ready to run.
    pub engine: &'a Engine,
    /// Instruction set of our kernels.
    pub isa: Isa,
    /// The frames' neighbours, where the model was fitted with them.
    pub shot: Option<&'a Shot<'a>>,
    /// Where lines go.
    pub output: &'a Output,
}
