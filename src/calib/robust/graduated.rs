//! Stage 1: a minimum of a loss that is not convex. Truncated least squares by graduated
//! non-convexity (yang2020), algorithm 1); Tukey's loss from the minimum of Huber's, which is the
//! only one it has.
//!
//! Neither guarantees the global minimum.

use crate::calib::{
    CalibError, Loss, LossFunctions, Poses, Solver, Termination, Weighting, robust::solution::Solution,
};

/// Control at which a residual of a million bounds still counts: larger ones may be rejected at
/// once.
const FIRST_CONTROL: f64 = 1e-12;

/// Minimises the sum of `losses`, from least squares or from the minimum of `huber`.
pub(crate) fn graduated(
    solver: &mut Solver<'_>,
    start: Poses,
    losses: &LossFunctions,
    huber: impl FnOnce() -> LossFunctions,
) -> Result<Solution, CalibError> {
    match losses.loss {
        Loss::Squared | Loss::Huber => Solution::of_losses(solver, start, losses),
        Loss::Tukey => {
            let start = Solution::of_losses(solver, start, &huber())?.iterate.poses;
            Solution::of_losses(solver, start, losses)
        }
        Loss::Truncated => truncated(solver, start, losses),
    }
}

fn truncated(solver: &mut Solver<'_>, start: Poses, losses: &LossFunctions) -> Result<Solution, CalibError> {
    let plain = Solution::least_squares(solver, start)?;
    let worst = losses.worst(&plain.iterate.chi2);
    // Nothing moves, or everything fits: nothing to reject. Or not even the worst has a number.
    if solver.problem.moving() == 0 || worst <= 1.0 || !worst.is_finite() {
        return Ok(Solution { losses: losses.clone(), ..plain });
    }
    let mu = (2.0 * worst - 1.0).recip().max(FIRST_CONTROL);
    let schedule = Weighting::Graduated { losses, mu };
    let (mut iterate, termination) = solver.minimise(schedule, plain.iterate.poses)?;
    if termination == Termination::OutOfIterations {
        iterate.cost = losses.cost(&iterate.chi2);
        return Ok(Solution::judged(iterate, losses, termination));
    }
    Solution::of_losses(solver, iterate.poses, losses)
}
