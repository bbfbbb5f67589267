//! The stages of robust estimation in their order.

use crate::calib::{
    CalibError, Loss, LossFunctions, Poses, Solver,
    robust::{
        ambiguity::ambiguity,
        coordinate_descent::coordinate_descent,
        graduated::graduated,
        length_prior::{LogOdds, length_prior, with_odds},
        solution::Solution,
    },
};

/// The best fit under `losses`: stages 1 and 2, again with what the length prior learned from them,
/// and the ambiguities that remain.
pub(crate) fn robust_fit(
    solver: &mut Solver<'_>,
    start: Poses,
    losses: &LossFunctions,
) -> Result<Solution, CalibError> {
    let first = descended(solver, start.clone(), losses, None)?;
    if !first.termination.is_converged() {
        return Ok(first);
    }
    let odds = length_prior(solver.problem.observations, &first.verdicts);
    let second = match &odds {
        Some(odds) => descended(solver, start, &with_odds(losses, odds), Some(odds))?,
        None => first,
    };
    if second.termination.is_converged() {
        ambiguity(solver, second, odds.as_ref(), losses)
    } else {
        Ok(second)
    }
}

/// Stages 1 and 2.
pub(crate) fn descended(
    solver: &mut Solver<'_>,
    start: Poses,
    losses: &LossFunctions,
    odds: Option<&LogOdds>,
) -> Result<Solution, CalibError> {
    let dimensions = &solver.problem.dimensions;
    let huber = || {
        let huber = LossFunctions::new(dimensions, Loss::Huber);
        odds.map_or_else(|| huber.clone(), |odds| with_odds(&huber, odds))
    };
    let solution = graduated(solver, start, losses, huber)?;
    if losses.loss == Loss::Truncated { coordinate_descent(solver, solution) } else { Ok(solution) }
}
