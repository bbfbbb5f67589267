//! The result of [`calibrate`](crate::calib::calibrate()): plain data.

use std::fmt;

use crate::calib::{
    ContactObservationId, DisplacementId, FreeComponent, Iteration, Loss, Marginals, Model, PerObservation,
    Pose, ResidualConvention, Termination, Verdict,
};
use crate::id::{Id, IdVec, VertexId};
use crate::skin::TaxelId;

/// The poses of the taxels, and how well the observations agree.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The unknowns of every taxel.
    pub model: Model,
    /// The ids of the taxels.
    pub ids: IdVec<VertexId, TaxelId>,
    /// Their poses; in the positions model the rotation is the identity.
    pub poses: IdVec<VertexId, Pose>,
    /// Their covariances, if wanted.
    pub marginals: Option<Marginals>,
    /// The convention of `cost` and `fit`.
    pub residual: ResidualConvention,
    /// The loss function whose sum is `cost`.
    pub loss: Loss,
    /// Half of the sum of the losses of all squared whitened residuals.
    pub cost: f64,
    /// Goodness of fit.
    pub fit: GoodnessOfFit,
    /// The residual and weight of every observation.
    pub diagnostics: PerObservation<ObservationDiagnostics>,
    /// Components whose absolute pose the contacts do not determine.
    pub free: Vec<FreeComponent>,
    /// The steps taken.
    pub iterations: Vec<Iteration>,
    /// Why it ended.
    pub termination: Termination,
    /// Wall-clock time, in s.
    pub seconds: f64,
}

impl Calibration {
    /// The edges and the contacts that were rejected: outliers with a reduced weight.
    pub fn rejected(&self) -> (Vec<DisplacementId>, Vec<ContactObservationId>) {
        fn of<I: Id>(diagnostics: &IdVec<I, ObservationDiagnostics>) -> Vec<I> {
            let is_rejected = |d: &ObservationDiagnostics| d.verdict == Verdict::Outlier && d.weight < 1.0;
            diagnostics.enumerate().filter(|(_, d)| is_rejected(d)).map(|(id, _)| id).collect()
        }
        (of(&self.diagnostics.edges), of(&self.diagnostics.contacts))
    }
}

/// The residual and weight of one observation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObservationDiagnostics {
    /// Squared whitened residual.
    pub chi2: f64,
    /// Its weight in the result: 1 in least squares.
    pub weight: f64,
    /// Whether the noise explains it.
    pub verdict: Verdict,
}

/// Whether the stated noise is credible.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoodnessOfFit {
    /// Sum of the squared whitened residuals of the inliers.
    pub chi2: f64,
    /// Numbers that the inliers observe.
    pub measurements: usize,
    /// Measurements minus unknown numbers.
    pub degrees_of_freedom: usize,
    /// Probability of a larger sum if the stated noise is right. Near 0 the noise is understated
    /// (or there are outliers), near 1 overstated. `None` under a loss that also reduces the weight
    /// of inliers: the sum is then not chi-square distributed.
    pub p: Option<f64>,
}

/// One calibration in a thousand is misjudged, on either side.
const MISJUDGED: f64 = 5e-4;

/// A chi-square over degrees of freedom this close to 1 means that the noise is stated to within 1
/// %: with a million observations chance alone does not explain this, but it is negligible in practice.
const NEGLIGIBLE: f64 = 0.02;

/// The judgement of the stated noise, as a sentence.
impl fmt::Display for GoodnessOfFit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ratio = self.chi2 / self.degrees_of_freedom as f64;
        f.write_str(match self.p {
            None => "this loss function also reduces the weight of inliers, so the noise cannot be judged; least squares and truncated least squares can judge it",
            _ if self.degrees_of_freedom == 0 => "there are no more measurements than unknowns, so the noise cannot be judged",
            _ if (ratio - 1.0).abs() < NEGLIGIBLE => "the stated noise is believable",
            _ if self.is_too_large() => "the observations disagree by more than the stated noise: it is understated, or some are wrong",
            Some(p) if p > 1.0 - MISJUDGED => "the observations agree better than the stated noise predicts: it is overstated, or they are not independent",
            Some(p) if p >= MISJUDGED => "the stated noise is believable",
            Some(_) => "the squared residuals are not finite numbers, so the noise cannot be judged",
        })
    }
}

impl GoodnessOfFit {
    /// Measurements over degrees of freedom: the factor by which fitting shrinks squared residuals.
    pub(super) fn redundancy(&self) -> f64 {
        self.measurements as f64 / self.degrees_of_freedom.max(1) as f64
    }

    /// Whether the observations disagree by more than the stated noise.
    pub(super) fn is_too_large(&self) -> bool {
        self.p.is_some_and(|p| p < MISJUDGED)
    }
}
