//! ε of relative squared errors.

/// Added to the squared channel mean in every relative squared error, of metrics and losses, so that black does not
/// divide by zero (Rousselle et al. 2011).
pub const REL_L2_EPSILON: f64 = 0.01;
