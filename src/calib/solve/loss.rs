//! Loss functions: the cost of a squared residual, and the weight that follows from it.
//!
//! A loss `rho(s)` of the squared whitened residual `s` is minimised by iteratively reweighted least squares
//! with the weight `rho'(s)`. Bounds depend on the number of measured numbers, so that the same share of
//! inliers is affected in every model. Sources: `(huber1964)`, Tukey's biweight `(beaton1974)`, the graduated
//! truncated loss `(yang2020)`.

use std::borrow::Cow;

use crate::calib::{DisplacementId, PerObservation};
use crate::numeric::quantile;

/// A loss function of squared whitened residuals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// The square itself: least squares. A single outlier moves the whole result.
    Squared,
    /// Huber: convex, grows linearly beyond its bound. Outliers keep a bounded influence.
    Huber,
    /// Tukey's biweight: constant beyond its bound. Started from Huber's solution; outliers lose
    /// all influence.
    Tukey,
    /// The square up to its bound, constant beyond it: truncated least squares, by graduated
    /// non-convexity. Needs no good start, and tolerates the most outliers.
    Truncated,
}

/// Whether the noise explains an observation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    /// Its squared residual is below the bound.
    Inlier,
    /// Its squared residual is above the bound.
    Outlier,
}

/// Share of inliers below the bound of Huber's loss, which does not change their weight.
const HUBER_SHARE: f64 = 0.95;

/// Share of inliers below the outlier bound: three standard deviations of a normal variable. With 0.99 the
/// lost inliers cost 2 % of the accuracy at 5 % outliers.
pub(crate) const INLIER_SHARE: f64 = 0.997;

/// Tukey's bound over Huber's: with 3 degrees of freedom, weights vanish at 6 standard deviations.
const TUKEY_OVER_HUBER: f64 = 2.147;

/// No weight falls below this: a taxel whose observations are all rejected keeps its pose instead
/// of making the system singular.
pub(crate) const SMALLEST_WEIGHT: f64 = 1e-8;

/// A loss for residuals of some dimension, with the squares of its bounds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct LossFunction {
    loss: Loss,
    /// The square at which the loss departs from the square, or becomes constant.
    bound2: f64,
    /// Squared residuals above this are outliers.
    pub(crate) outlier2: f64,
}

impl LossFunction {
    /// The loss of an observation of `dimension` numbers; without numbers there is no residual, and any bound
    /// is valid.
    pub(crate) fn new(loss: Loss, dimension: usize) -> Self {
        let degrees = dimension.max(1) as f64;
        let bound2 = match loss {
            Loss::Squared => f64::INFINITY,
            Loss::Huber => quantile(HUBER_SHARE, degrees),
            Loss::Tukey => quantile(HUBER_SHARE, degrees) * TUKEY_OVER_HUBER * TUKEY_OVER_HUBER,
            Loss::Truncated => quantile(INLIER_SHARE, degrees),
        };
        let outlier2 = if bound2.is_finite() { quantile(INLIER_SHARE, degrees) } else { f64::INFINITY };
        Self { loss, bound2, outlier2 }
    }

    pub(crate) fn is_inlier(&self, chi2: f64) -> bool {
        chi2 <= self.outlier2
    }

    /// The square at which the loss departs from the square, or becomes constant.
    pub(crate) fn bound2(&self) -> f64 {
        self.bound2
    }

    /// The loss with squared bounds that are larger by `factor`.
    pub(crate) fn scaled(self, factor: f64) -> Self {
        Self { bound2: self.bound2 * factor, outlier2: self.outlier2 * factor, ..self }
    }

    pub(crate) fn cost(&self, chi2: f64) -> f64 {
        let c2 = self.bound2;
        match self.loss {
            Loss::Squared => chi2,
            Loss::Huber if chi2 <= c2 => chi2,
            Loss::Huber => 2.0 * (c2 * chi2).sqrt() - c2,
            Loss::Tukey if chi2 >= c2 => c2 / 3.0,
            Loss::Tukey => c2 / 3.0 * (1.0 - (1.0 - chi2 / c2).powi(3)),
            Loss::Truncated => chi2.min(c2),
        }
    }

    /// `rho'(chi2)`: the weight of the observation.
    pub(crate) fn weight(&self, chi2: f64) -> f64 {
        let c2 = self.bound2;
        let weight = match self.loss {
            Loss::Squared => 1.0,
            Loss::Huber if chi2 <= c2 => 1.0,
            Loss::Huber => (c2 / chi2).sqrt(),
            Loss::Tukey => (1.0 - chi2 / c2).max(0.0).powi(2),
            Loss::Truncated => f64::from(u8::from(chi2 <= c2)),
        };
        weight.max(SMALLEST_WEIGHT)
    }

    /// Weight of the graduated truncated loss at control `mu`: nearly convex for small `mu`, the
    /// truncation itself as it grows (equation 14 of `(yang2020)`).
    pub(crate) fn graduated_weight(&self, mu: f64, chi2: f64) -> f64 {
        let c2 = self.bound2;
        let weight = if chi2 <= mu / (mu + 1.0) * c2 {
            1.0
        } else if chi2 >= (mu + 1.0) / mu * c2 {
            0.0
        } else {
            (c2 * mu * (mu + 1.0) / chi2).sqrt() - mu
        };
        weight.max(SMALLEST_WEIGHT)
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LossFunctions {
    pub(crate) loss: Loss,
    pub(crate) of: PerObservation<LossFunction>,
}

impl LossFunctions {
    /// Losses with bounds that follow from the number of measured numbers of each observation.
    pub(crate) fn new(dimensions: &PerObservation<usize>, loss: Loss) -> Self {
        // Quantiles are slow, and there are few dimensions.
        let most = dimensions.iter().max().unwrap_or(0);
        let of_dimension: Vec<LossFunction> = (0..=most).map(|n| LossFunction::new(loss, n)).collect();
        Self { loss, of: dimensions.map(|n| of_dimension[n]) }
    }

    /// The losses with squared bounds scaled by a factor for each edge, and by one for all contacts.
    pub(crate) fn scaled(&self, edge: impl Fn(DisplacementId) -> f64, contact: f64) -> Self {
        let edges = self.of.edges.enumerate().map(|(e, f)| f.scaled(edge(e))).collect();
        let contacts = self.of.contacts.map(|f| f.scaled(contact));
        Self { loss: self.loss, of: PerObservation { edges, contacts } }
    }

    pub(crate) fn cost(&self, chi2: &PerObservation) -> f64 {
        0.5 * self.of.zip(chi2, |f, chi2| f.cost(chi2)).iter().sum::<f64>()
    }

    pub(crate) fn weights(&self, chi2: &PerObservation) -> PerObservation {
        self.of.zip(chi2, |f, chi2| f.weight(chi2))
    }

    pub(crate) fn verdicts(&self, chi2: &PerObservation) -> PerObservation<Verdict> {
        self.of.zip(chi2, |f, chi2| if f.is_inlier(chi2) { Verdict::Inlier } else { Verdict::Outlier })
    }

    /// [`LossFunction::graduated_weight`] of every observation.
    pub(crate) fn graduated_weights(&self, mu: f64, chi2: &PerObservation) -> PerObservation {
        self.of.zip(chi2, |f, chi2| f.graduated_weight(mu, chi2))
    }

    /// The largest squared residual over its squared bound.
    pub(crate) fn worst(&self, chi2: &PerObservation) -> f64 {
        self.of.zip(chi2, |f, chi2| chi2 / f.bound2).iter().fold(0.0, f64::max)
    }
}

/// The weights of squared residuals during the optimisation.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Weighting<'w> {
    /// From loss functions, recomputed at every step.
    Loss(&'w LossFunctions),
    Fixed(&'w PerObservation),
    /// Those of the graduated loss at control `mu`, which grows after every step until it reaches
    /// the truncated loss (algorithm 1 of `(yang2020)`).
    Graduated {
        losses: &'w LossFunctions,
        mu: f64,
    },
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

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Loss; 4] = [Loss::Squared, Loss::Huber, Loss::Tukey, Loss::Truncated];

    #[test]
    fn weights_are_the_slopes_of_costs() {
        for loss in ALL {
            let function = LossFunction::new(loss, 3);
            for square in [0.0, 0.1, 3.0, 7.0, 9.0, 20.0, 30.0, 50.0, 1e4] {
                let h = 1e-4 * (1.0 + square);
                let slope = (function.cost(square + h) - function.cost(square)) / h;
                let weight = function.weight(square + 0.5 * h);
                assert!((slope - weight).abs() < 1e-6, "{loss:?} at {square}: {slope} is not {weight}");
            }
        }
    }

    #[test]
    fn small_errors_count_as_in_least_squares() {
        for loss in ALL {
            let function = LossFunction::new(loss, 6);
            assert!((function.weight(1e-12) - 1.0).abs() < 1e-9, "{loss:?}");
            assert!((function.cost(1e-6) - 1e-6).abs() < 1e-12, "{loss:?}");
        }
    }

    #[test]
    fn graduated_weights_end_in_truncation() {
        let function = LossFunction::new(Loss::Truncated, 3);
        for square in [0.5 * function.bound2, 2.0 * function.bound2] {
            let late = function.graduated_weight(1e6, square);
            assert!((late - function.weight(square)).abs() < 1e-6, "{late} at {square}");
        }
    }
}
