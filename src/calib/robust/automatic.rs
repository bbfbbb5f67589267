//! The stages in their order ([`robust_fit`]), and stage 5: whether robust estimation is needed at
//! all, and at which noise scale.
//!
//! Least squares first. If its chi-square is too large or one residual is an outlier, refit with
//! truncated least squares. If the scale of the residuals is then larger than stated, the noise is
//! understated: estimate the scale again with bounds that are wider by it, and refit with those.
//! *Heuristic*: further rounds of that estimate change the RMSE by less than 0.2 % up to 20 % wrong
//! edges. The refit is kept only if it found an outlier that is one at any scale, and left most
//! observations.

use crate::calib::{
    CalibError, Loss, LossFunctions, Poses, Solver, Termination, Verdict,
    robust::{
        ambiguity::ambiguity,
        coordinate_descent::coordinate_descent,
        goodness_of_fit::goodness_of_fit,
        graduated::graduated,
        length_prior::{LogOdds, length_prior, with_odds},
        scale::{Scale, has_outlier},
        solution::Solution,
    },
};

/// Share of the edges, or of the contacts, that can be wrong for the others to decide.
const MOST_REJECTED: f64 = 0.5;

/// Least squares, or truncated least squares where it finds outliers.
pub(crate) fn automatic(solver: &mut Solver<'_>, start: Poses) -> Result<Solution, CalibError> {
    let plain = Solution::least_squares(solver, start)?;
    if !is_doubtful(solver, &plain) {
        return Ok(plain);
    }
    match refit(solver, &plain) {
        Ok(Some(refit)) => Ok(refit),
        // Or a taxel depends on what was rejected: then nothing decides.
        Ok(None) | Err(CalibError::Undetermined { .. }) => Ok(plain),
        Err(other) => Err(other),
    }
}

/// Whether least squares leaves more than the stated noise explains, or one observation is an
/// outlier.
fn is_doubtful(solver: &Solver<'_>, plain: &Solution) -> bool {
    if !plain.termination.is_converged() {
        return true;
    }
    let (dimensions, chi2) = (&solver.problem.dimensions, &plain.iterate.chi2);
    // Where every square is within its bound there is nothing to reject.
    if LossFunctions::new(dimensions, Loss::Truncated).worst(chi2) <= 1.0 {
        return false;
    }
    let fit = goodness_of_fit(solver, plain);
    // Fitting makes the squares of all smaller.
    let leverage = fit.redundancy();
    fit.is_too_large()
        || fit.degrees_of_freedom > 0 && has_outlier(dimensions, leverage, chi2, &plain.verdicts, |_| true)
}

/// Truncated least squares at the scale of the noise, if that is better than `plain`.
fn refit(solver: &mut Solver<'_>, plain: &Solution) -> Result<Option<Solution>, CalibError> {
    let start = || plain.iterate.poses.clone();
    let stated = LossFunctions::new(&solver.problem.dimensions, Loss::Truncated);
    let mut found = robust_fit(solver, start(), &stated)?;
    if found.termination == Termination::OutOfIterations {
        // There is doubt, and no means to resolve it.
        return Ok(Some(found));
    }
    let scale = Scale::of(solver, &found);
    if !scale.is_as_stated() {
        let wide = descended(solver, start(), &scale.of_losses(&stated), None)?;
        let scale = scale.max(Scale::of(solver, &wide));
        let wide = robust_fit(solver, start(), &scale.of_losses(&stated))?;
        let mut both = wide.verdicts.edges.iter().zip(&found.verdicts.edges);
        let is_torn = both.any(|(&wide, &stated)| wide != Verdict::Inlier && stated == Verdict::Inlier);
        // Contacts that contradict each other make outliers of edges that agree without them.
        if scale.is_as_stated_of_edges() && is_torn {
            return Ok(None);
        }
        found = wide;
    }
    Ok(is_better(solver, &found, plain).then_some(found))
}

/// Whether the refit rejected an outlier, and left enough to decide. Where nothing is wrong but the
/// stated noise, what is rejected is not an outlier relative to the others.
fn is_better(solver: &Solver<'_>, found: &Solution, plain: &Solution) -> bool {
    let fit = goodness_of_fit(solver, found);
    // Fitting makes the squares of the others smaller, and those of what was rejected as much
    // larger.
    let leverage = fit.redundancy() * fit.redundancy();
    let is_rejected = |v: Verdict| v != Verdict::Inlier;
    let (dimensions, chi2) = (&solver.problem.dimensions, &found.iterate.chi2);
    found.termination.is_converged()
        && found.rejects_at_most(MOST_REJECTED)
        && fit.degrees_of_freedom > 0
        && (!plain.termination.is_converged()
            || has_outlier(dimensions, leverage, chi2, &found.verdicts, is_rejected))
}

/// The best fit under `losses`: stages 1 and 2, again with what the length prior learned from them,
/// and the ambiguities that remain.
pub(crate) fn robust_fit(
    solver: &mut Solver<'_>,
    start: Poses,
    losses: &LossFunctions,
) -> Result<Solution, CalibError> {
    let (fit, odds) = with_length_prior(solver, start, losses)?;
    if !fit.termination.is_converged() {
        return Ok(fit);
    }
    ambiguity(solver, fit, odds.as_ref(), losses)
}

/// Stages 1 and 2, and again with what the length prior learned from them.
pub(super) fn with_length_prior(
    solver: &mut Solver<'_>,
    start: Poses,
    losses: &LossFunctions,
) -> Result<(Solution, Option<LogOdds>), CalibError> {
    let first = descended(solver, start.clone(), losses, None)?;
    let is_usable = first.termination.is_converged();
    let odds = if is_usable { length_prior(solver.problem.observations, &first.verdicts) } else { None };
    let fit = match &odds {
        Some(odds) => descended(solver, start, &with_odds(losses, odds), Some(odds))?,
        None => first,
    };
    Ok((fit, odds))
}

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
