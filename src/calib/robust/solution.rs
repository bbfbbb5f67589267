//! What a stage of robust estimation hands to the next: poses, and a verdict on every observation.

use crate::calib::{
    CalibError, Iterate, Loss, LossFunctions, PerObservation, Poses, SMALLEST_WEIGHT, Solver, Termination,
    Verdict, Weighting,
};

/// Poses with the verdicts and weights that they were found with.
#[derive(Debug, Clone)]
pub(crate) struct Solution {
    pub(crate) iterate: Iterate,
    pub(crate) verdicts: PerObservation<Verdict>,
    /// Derived from verdicts and losses, never the other way round.
    pub(crate) weights: PerObservation,
    pub(crate) losses: LossFunctions,
    pub(crate) termination: Termination,
}

/// Weight of ambiguous observations: too small to bend the surroundings, large enough to leave the
/// system well conditioned, and a covariance as wide as the contradiction.
const AMBIGUOUS_WEIGHT: f64 = 1e-3;

impl Solution {
    /// The minimum of least squares; every observation counts.
    pub(crate) fn least_squares(solver: &mut Solver<'_>, start: Poses) -> Result<Self, CalibError> {
        let dimensions = &solver.problem.dimensions;
        let losses = LossFunctions::new(dimensions, Loss::Squared);
        let weights = dimensions.map(|_| 1.0);
        let (iterate, termination) = solver.minimise(Weighting::Fixed(&weights), start)?;
        let verdicts = weights.map(|_| Verdict::Inlier);
        Ok(Self { iterate, verdicts, weights, losses, termination })
    }

    /// A minimum of the sum of `losses`, near `start`.
    pub(crate) fn of_losses(
        solver: &mut Solver<'_>,
        start: Poses,
        losses: &LossFunctions,
    ) -> Result<Self, CalibError> {
        let (iterate, termination) = solver.minimise(Weighting::Loss(losses), start)?;
        Ok(Self::judged(iterate, losses, termination))
    }

    /// Verdicts and weights by the squared residuals of `iterate`.
    pub(crate) fn judged(iterate: Iterate, losses: &LossFunctions, termination: Termination) -> Self {
        let (weights, verdicts) = (losses.weights(&iterate.chi2), losses.verdicts(&iterate.chi2));
        Self { iterate, verdicts, weights, losses: losses.clone(), termination }
    }

    /// Solves again under other `verdicts`. The cost stays that of the losses.
    pub(crate) fn under(
        self,
        solver: &mut Solver<'_>,
        verdicts: PerObservation<Verdict>,
    ) -> Result<Self, CalibError> {
        let Self { iterate, losses, .. } = self;
        let weights = weights_of(&verdicts, &losses, &iterate.chi2);
        let (mut iterate, termination) = solver.minimise(Weighting::Fixed(&weights), iterate.poses)?;
        iterate.cost = losses.cost(&iterate.chi2);
        Ok(Self { iterate, verdicts, weights, losses, termination })
    }

    /// Whether no more than this `share` of the edges was rejected, and of the contacts.
    pub(crate) fn rejects_at_most(&self, share: f64) -> bool {
        let few = |verdicts: &[Verdict]| {
            let rejected = verdicts.iter().filter(|&&v| v != Verdict::Inlier).count();
            rejected as f64 <= share * verdicts.len() as f64
        };
        few(&self.verdicts.edges) && few(&self.verdicts.contacts)
    }
}

/// Truncated least squares counts inliers fully and outliers not at all; other losses weigh by the
/// residual. No inlier counts less than an ambiguous observation.
fn weights_of(
    verdicts: &PerObservation<Verdict>,
    losses: &LossFunctions,
    chi2: &PerObservation,
) -> PerObservation {
    verdicts.zip(&losses.weights(chi2), |verdict, by_loss| match verdict {
        Verdict::Ambiguous => AMBIGUOUS_WEIGHT,
        Verdict::Inlier if losses.loss == Loss::Truncated => 1.0,
        Verdict::Outlier if losses.loss == Loss::Truncated => SMALLEST_WEIGHT,
        Verdict::Inlier => by_loss.max(AMBIGUOUS_WEIGHT),
        Verdict::Outlier => by_loss,
    })
}
