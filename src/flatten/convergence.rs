//! How far the minimisation of a map came.

/// Whether a map is a minimum of its energy.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize)]
pub struct Convergence {
    /// Whether the minimisation ended at a minimum: not by its limit of steps, and not where no step
    /// lowers an energy whose gradient promises it.
    pub converged: bool,
    /// Length of the gradient of the energy over the energy, with positions in units of the square
    /// root of the area; that of what keeps holes open and loops apart is counted in. 0 for a map
    /// that minimises nothing.
    pub gradient: f64,
}
