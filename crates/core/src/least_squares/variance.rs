//! How much of the noise residuals show.

/// The share of the variance `noise` that a fit leaves in a residual of weight `weight` (1: it counts fully), where the
/// fit predicts that residual with the variance `prediction`: `1 + (1 - 2 weight) prediction / noise`.
pub(crate) fn share_left(weight: f64, prediction: f64, noise: f64) -> f64 {
    1.0 + (1.0 - 2.0 * weight) * prediction / noise
}
