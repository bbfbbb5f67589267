//! The optimiser: it knows residuals and weights, and nothing of outliers.

pub(crate) mod gauge;
pub(crate) mod initial;
pub(crate) mod levenberg_marquardt;
pub(crate) mod loss;
pub(crate) mod marginals;
pub(crate) mod normal_equations;
pub(crate) mod residual;
