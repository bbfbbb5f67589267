//! The weights of squared residuals: given, from a loss function (iteratively reweighted least
//! squares), or from the schedule of graduated non-convexity (yang2020).

use std::borrow::Cow;

use crate::calib::{observations::graph::PerObservation, solve::loss::LossFunctions};

/// The weights of squared residuals while the optimisation runs.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Weighting<'w> {
    /// From loss functions, at every step anew.
    Loss(&'w LossFunctions),
    /// Given.
    Fixed(&'w PerObservation),
    /// Those of the graduated loss at control `mu`, which grows after every step until it reaches
    /// the truncated loss (yang2020), algorithm 1).
    Graduated { losses: &'w LossFunctions, mu: f64 },
}

impl Weighting<'_> {
    pub(super) fn weights(&self, chi2: &PerObservation) -> Cow<'_, PerObservation> {
        match self {
            Self::Loss(losses) => Cow::Owned(losses.weights(chi2)),
            Self::Fixed(weights) => Cow::Borrowed(weights),
            Self::Graduated { losses, mu } => Cow::Owned(losses.graduated_weights(*mu, chi2)),
        }
    }

    pub(super) fn cost(&self, chi2: &PerObservation) -> f64 {
        match self {
            Self::Loss(losses) => losses.cost(chi2),
            Self::Fixed(_) | Self::Graduated { .. } => {
                let weights = self.weights(chi2);
                0.5 * weights.iter().zip(chi2.iter()).map(|(w, s)| w * s).sum::<f64>()
            }
        }
    }
}
