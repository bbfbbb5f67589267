//! Which loss function each observation has, the weights that follow from it, and verdicts: whether noise explains an
//! observation.
//!
//! Bounds depend on the number of measured numbers, so that the same share of inliers is affected in every model.

use std::borrow::Cow;

use crate::calib::{DisplacementId, PerObservation};
use crate::least_squares::{LossFunction, inlier_bound2};

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

/// The loss of one observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct BoundedLoss {
    pub(crate) function: LossFunction,
    /// Squared residuals above this are outliers.
    pub(crate) outlier2: f64,
}

impl BoundedLoss {
    /// The loss of an observation of `dimension` numbers; without numbers there is no residual, and any bound
    /// is valid.
    fn new(loss: Loss, dimension: usize) -> Self {
        let (function, outlier2) = match loss {
            Loss::Squared => (LossFunction::Squared, f64::INFINITY),
            Loss::Huber => (LossFunction::huber(dimension), inlier_bound2(dimension)),
            Loss::Tukey => (LossFunction::tukey(dimension), inlier_bound2(dimension)),
            Loss::Truncated => (LossFunction::truncated(dimension), inlier_bound2(dimension)),
        };
        Self { function, outlier2 }
    }

    pub(crate) fn is_inlier(&self, chi2: f64) -> bool {
        chi2 <= self.outlier2
    }

    /// The loss with squared bounds that are larger by `factor`.
    fn scaled(self, factor: f64) -> Self {
        Self { function: self.function.scaled(factor), outlier2: self.outlier2 * factor }
    }
}

#[derive(Debug, Clone, PartialEq)]
pub(crate) struct LossFunctions {
    pub(crate) loss: Loss,
    pub(crate) of: PerObservation<BoundedLoss>,
}

impl LossFunctions {
    /// Losses with bounds that follow from the number of measured numbers of each observation.
    pub(crate) fn new(dimensions: &PerObservation<usize>, loss: Loss) -> Self {
        // Quantiles are slow, and there are few dimensions.
        let most = dimensions.iter().max().unwrap_or(0);
        let of_dimension: Vec<BoundedLoss> = (0..=most).map(|n| BoundedLoss::new(loss, n)).collect();
        Self { loss, of: dimensions.map(|n| of_dimension[n]) }
    }

    /// The losses with squared bounds scaled by a factor for each edge, and by one for all contacts.
    pub(crate) fn scaled(&self, edge: impl Fn(DisplacementId) -> f64, contact: f64) -> Self {
        let edges = self.of.edges.enumerate().map(|(e, f)| f.scaled(edge(e))).collect();
        let contacts = self.of.contacts.map(|f| f.scaled(contact));
        Self { loss: self.loss, of: PerObservation { edges, contacts } }
    }

    pub(crate) fn cost(&self, chi2: &PerObservation) -> f64 {
        0.5 * self.of.zip(chi2, |f, chi2| f.function.cost(chi2)).iter().sum::<f64>()
    }

    pub(crate) fn weights(&self, chi2: &PerObservation) -> PerObservation {
        self.of.zip(chi2, |f, chi2| f.function.weight(chi2))
    }

    pub(crate) fn verdicts(&self, chi2: &PerObservation) -> PerObservation<Verdict> {
        self.of.zip(chi2, |f, chi2| if f.is_inlier(chi2) { Verdict::Inlier } else { Verdict::Outlier })
    }

    /// Weights of the graduated truncated loss at control `mu`.
    pub(crate) fn graduated_weights(&self, mu: f64, chi2: &PerObservation) -> PerObservation {
        let graduated = |f: BoundedLoss| LossFunction::Graduated { c2: f.function.bound2(), mu };
        self.of.zip(chi2, |f, chi2| graduated(f).weight(chi2))
    }

    /// The largest squared residual over its squared bound.
    pub(crate) fn worst(&self, chi2: &PerObservation) -> f64 {
        self.of.zip(chi2, |f, chi2| chi2 / f.function.bound2()).iter().fold(0.0, f64::max)
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
