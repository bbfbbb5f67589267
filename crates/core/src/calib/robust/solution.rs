//! The result of a stage of robust estimation: poses, and a verdict on every observation; and stage 1, the
//! minimum of a loss that is not convex.

use crate::calib::{
    CalibError, Iterate, Loss, LossFunctions, PerObservation, Poses, Solver, Termination, Verdict, Weighting,
    robust::length_prior::{LogOdds, with_odds},
};

/// Poses with their verdicts and weights.
#[derive(Debug, Clone)]
pub(crate) struct Solution {
    pub(crate) iterate: Iterate,
    pub(crate) verdicts: PerObservation<Verdict>,
    /// Derived from verdicts and losses; verdicts are never derived from weights.
    pub(crate) weights: PerObservation,
    pub(crate) losses: LossFunctions,
    pub(crate) termination: Termination,
}

/// Control with which a residual of a million bounds still has weight; larger ones may be rejected at once.
const FIRST_CONTROL: f64 = 1e-12;

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

    /// Stage 1: a minimum of the sum of `losses`, their bounds scaled by `odds` if there are any.
    ///
    /// Truncated least squares by graduated non-convexity (algorithm 1 of `(yang2020)`), started from least
    /// squares. Tukey's loss is started from the minimum of Huber's loss, which is unique. Neither guarantees
    /// the global minimum.
    pub(crate) fn graduated(
        solver: &mut Solver<'_>,
        start: Poses,
        losses: &LossFunctions,
        odds: Option<&LogOdds>,
    ) -> Result<Self, CalibError> {
        let scaled = |losses: &LossFunctions| match odds {
            Some(odds) => with_odds(losses, odds),
            None => losses.clone(),
        };
        match losses.loss {
            Loss::Squared | Loss::Huber => Self::of_losses(solver, start, &scaled(losses)),
            Loss::Tukey => {
                let huber = scaled(&LossFunctions::new(&solver.problem.dimensions, Loss::Huber));
                let start = Self::of_losses(solver, start, &huber)?.iterate.poses;
                Self::of_losses(solver, start, &scaled(losses))
            }
            Loss::Truncated => Self::truncated(solver, start, &scaled(losses)),
        }
    }

    fn truncated(solver: &mut Solver<'_>, start: Poses, losses: &LossFunctions) -> Result<Self, CalibError> {
        let plain = Self::least_squares(solver, start)?;
        let worst = losses.worst(&plain.iterate.chi2);
        // Nothing to reject, since nothing moves or everything fits; or a residual is not finite.
        if solver.problem.moving() == 0 || worst <= 1.0 || !worst.is_finite() {
            return Ok(Self { losses: losses.clone(), ..plain });
        }
        let mu = (2.0 * worst - 1.0).recip().max(FIRST_CONTROL);
        let schedule = Weighting::Graduated { losses, mu };
        let (mut iterate, termination) = solver.minimise(schedule, plain.iterate.poses)?;
        if !termination.is_converged() {
            iterate.cost = losses.cost(&iterate.chi2);
            return Ok(Self::judged(iterate, losses, termination));
        }
        Self::of_losses(solver, iterate.poses, losses)
    }

    /// Whether at most this `share` of the edges, and of the contacts, was rejected.
    pub(crate) fn rejects_at_most(&self, share: f64) -> bool {
        let few = |verdicts: &[Verdict]| {
            let rejected = verdicts.iter().filter(|&&v| v != Verdict::Inlier).count();
            rejected as f64 <= share * verdicts.len() as f64
        };
        few(self.verdicts.edges.as_slice()) && few(self.verdicts.contacts.as_slice())
    }
}
