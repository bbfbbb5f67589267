//! The optimiser: from observations and weights to poses and covariances. It does not detect outliers.

pub(super) mod gauge;
pub(super) mod initial;
pub(super) mod loss;
pub(super) mod marginals;
pub(super) mod normal_equations;
pub(super) mod residual;
pub(super) mod solver;
