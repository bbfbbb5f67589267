//! What [`calibrate`](crate::calib::calibrate()) finds: plain data.

use crate::{
    calib::{
        ContactObservationId, DisplacementId, FreeComponent, Iteration, Loss, Marginals, Model, Pose,
        ResidualConvention, Termination, Verdict, observations::graph::PerObservation,
    },
    id::{IdVec, VertexId},
    skin::TaxelId,
};

/// Where the taxels are, and how well the observations agree.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// What was unknown of every taxel.
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
    /// How well every observation fits, and how much it counts.
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
    /// The edges that were rejected, or are ambiguous, and count less than the others.
    pub fn rejected_edges(&self) -> impl Iterator<Item = DisplacementId> {
        self.diagnostics.edges.enumerate().filter(|(_, d)| d.is_rejected()).map(|(e, _)| e)
    }

    /// The contacts that were rejected.
    pub fn rejected_contacts(&self) -> impl Iterator<Item = ContactObservationId> {
        self.diagnostics.contacts.enumerate().filter(|(_, d)| d.is_rejected()).map(|(c, _)| c)
    }

    /// Number of rejected edges and contacts.
    #[must_use]
    pub fn rejected(&self) -> usize {
        self.rejected_edges().count() + self.rejected_contacts().count()
    }
}

/// How well one observation fits, and how much it counts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ObservationDiagnostics {
    /// Squared whitened residual.
    pub chi2: f64,
    /// Its weight in the result: 1 in least squares.
    pub weight: f64,
    /// Whether the noise explains it.
    pub verdict: Verdict,
}

impl ObservationDiagnostics {
    /// Whether it counts less than the others because it is not an inlier.
    #[must_use]
    pub(crate) fn is_rejected(&self) -> bool {
        self.verdict != Verdict::Inlier && self.weight < 1.0
    }
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
const DOUBTFUL: f64 = 5e-4;

/// A chi-square over degrees of freedom this close to 1 means that the noise is stated to within 1
/// %: among a million observations chance excludes even that, but no user minds.
const NEGLIGIBLE: f64 = 0.02;

impl GoodnessOfFit {
    /// What it means for the stated noise, as a sentence.
    #[must_use]
    pub fn assessment(&self) -> &'static str {
        let Some(p) = self.p else {
            return "this loss function also reduces the weight of inliers, so the noise cannot be judged; none and gnc can judge it";
        };
        if self.degrees_of_freedom == 0 {
            "there are no more measurements than unknowns, so the noise cannot be judged"
        } else if (self.chi2 / self.degrees_of_freedom as f64 - 1.0).abs() < NEGLIGIBLE {
            "the stated noise is believable"
        } else if self.is_too_large() {
            "the observations disagree by more than the stated noise: it is understated, or some are wrong"
        } else if p > 1.0 - DOUBTFUL {
            "the observations agree better than the stated noise predicts: it is overstated, or they are not independent"
        } else {
            "the stated noise is believable"
        }
    }

    /// Measurements over degrees of freedom: the factor by which fitting shrinks squared residuals.
    pub(super) fn redundancy(&self) -> f64 {
        self.measurements as f64 / self.degrees_of_freedom.max(1) as f64
    }

    /// Whether the observations disagree by more than the stated noise.
    pub(super) fn is_too_large(&self) -> bool {
        self.p.is_some_and(|p| p < DOUBTFUL)
    }
}
