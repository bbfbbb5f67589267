//! The stages in their order ([`robust_fit`]), and stage 3: whether robust estimation is needed, and at which
//! noise scale: the ratio of the residuals of most observations to those that their stated noise predicts, by
//! the median `(rousseeuw1987)`.
//!
//! Least squares first. If its chi-square is too large or one residual is an outlier, refit with truncated
//! least squares. If the scale of the residuals is then larger than stated, the noise is understated:
//! estimate the scale again with bounds that are wider by it, and refit with those. *Heuristic*: further
//! rounds of that estimate change the RMSE by less than 0.2 % up to 20 % wrong edges. The refit is kept only
//! if it found an observation that is an outlier at any scale, and rejected at most half.

use crate::{
    calib::{
        CalibError, Loss, LossFunctions, PerObservation, Poses, Solver, Termination, Verdict, Weighting,
        components,
        robust::{goodness_of_fit::goodness_of_fit, length_prior::length_prior, solution::Solution},
    },
    numeric::{nth_smallest, quantile},
};

/// Largest share of the edges, or of the contacts, that may be rejected.
const MOST_REJECTED: f64 = 0.5;

/// Least squares, or truncated least squares where it finds outliers.
pub(crate) fn automatic(solver: &mut Solver<'_>, start: Poses) -> Result<Solution, CalibError> {
    let plain = Solution::least_squares(solver, start)?;
    if !is_doubtful(solver, &plain) {
        return Ok(plain);
    }
    match refit(solver, &plain) {
        Ok(Some(refit)) => Ok(refit),
        // If a taxel depends on rejected observations, least squares is kept.
        Ok(None) | Err(CalibError::Undetermined { .. }) => Ok(plain),
        Err(other) => Err(other),
    }
}

/// Whether the residuals of least squares are larger than the stated noise explains, or one observation is an
/// outlier.
fn is_doubtful(solver: &Solver<'_>, plain: &Solution) -> bool {
    if !plain.termination.is_converged() {
        return true;
    }
    let (dimensions, chi2) = (&solver.problem.dimensions, &plain.iterate.chi2);
    // If every square is within its bound there is nothing to reject.
    if LossFunctions::new(dimensions, Loss::Truncated).worst(chi2) <= 1.0 {
        return false;
    }
    let fit = goodness_of_fit(solver, plain);
    // Fitting reduces all squares.
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
        // The doubt cannot be resolved.
        return Ok(Some(found));
    }
    let scale = Scale::of(solver, &found);
    if !scale.is_as_stated() {
        let wide = Solution::graduated(solver, start(), &scale.of_losses(&stated), None)?;
        let scale = scale.max(Scale::of(solver, &wide));
        let wide = robust_fit(solver, start(), &scale.of_losses(&stated))?;
        let mut both = wide.verdicts.edges.iter().zip(&found.verdicts.edges);
        let is_torn = both.any(|(&wide, &stated)| wide != Verdict::Inlier && stated == Verdict::Inlier);
        // Contradicting contacts turn edges that agree without them into outliers.
        if scale.is_as_stated_of_edges() && is_torn {
            return Ok(None);
        }
        found = wide;
    }
    Ok(is_better(solver, &found, plain).then_some(found))
}

/// Whether the refit rejected an outlier, and kept enough observations. If only the stated noise is wrong,
/// rejected observations are not outliers relative to the others.
fn is_better(solver: &Solver<'_>, found: &Solution, plain: &Solution) -> bool {
    let fit = goodness_of_fit(solver, found);
    // Fitting reduces the squares of inliers, and enlarges those of rejected observations by the same factor.
    let leverage = fit.redundancy() * fit.redundancy();
    let is_rejected = |v: Verdict| v != Verdict::Inlier;
    let (dimensions, chi2) = (&solver.problem.dimensions, &found.iterate.chi2);
    found.termination.is_converged()
        && found.rejects_at_most(MOST_REJECTED)
        && fit.degrees_of_freedom > 0
        && (!plain.termination.is_converged()
            || has_outlier(dimensions, leverage, chi2, &found.verdicts, is_rejected))
}

/// The best fit under `losses`: stage 1, and again with the length prior learned from it; then taxels that
/// lost all their edges are reconnected.
pub(crate) fn robust_fit(
    solver: &mut Solver<'_>,
    start: Poses,
    losses: &LossFunctions,
) -> Result<Solution, CalibError> {
    let mut fit = Solution::graduated(solver, start.clone(), losses, None)?;
    if fit.termination.is_converged()
        && let Some(odds) = length_prior(solver.problem.observations, &fit.verdicts)
    {
        fit = Solution::graduated(solver, start, losses, Some(&odds))?;
    }
    if fit.termination.is_converged() { connected(solver, fit, losses) } else { Ok(fit) }
}

/// Weight of rejected edges that alone join two components: too small to distort the surroundings, large
/// enough for a covariance about as large as the contradiction.
const JOINING_WEIGHT: f64 = 1e-3;

/// Joins components that lost all edges to the rest: edges between them within the bounds of `losses` become
/// inliers, whatever their lengths, and the others get a small weight.
///
/// This does not change the RMSE, but covariances: a single taxel without any edge would have a sigma of 10
/// m, and in the centroid gauge this would affect all others.
fn connected(
    solver: &mut Solver<'_>,
    mut fit: Solution,
    losses: &LossFunctions,
) -> Result<Solution, CalibError> {
    let observations = solver.problem.observations;
    let (components, of_taxel) = components(observations, |e| fit.verdicts.edges[e] == Verdict::Inlier);
    let mut is_held: Vec<bool> = components.iter().map(|c| c.fixed).collect();
    for (id, contact) in observations.contacts.enumerate() {
        is_held[of_taxel[contact.taxel]] |= fit.verdicts.contacts[id] == Verdict::Inlier;
    }
    let mut is_changed = false;
    for (e, edge) in observations.edges.enumerate() {
        let (from, to) = (of_taxel[edge.from], of_taxel[edge.to]);
        if from == to || is_held[from] && is_held[to] || !edge.is_observed() {
            continue;
        }
        is_changed = true;
        if losses.of.edges[e].is_inlier(fit.iterate.chi2.edges[e]) {
            (fit.verdicts.edges[e], fit.weights.edges[e]) = (Verdict::Inlier, 1.0);
        } else {
            fit.weights.edges[e] = fit.weights.edges[e].max(JOINING_WEIGHT);
        }
    }
    if is_changed {
        let poses = fit.iterate.poses;
        (fit.iterate, fit.termination) = solver.minimise(Weighting::Fixed(&fit.weights), poses)?;
        fit.iterate.cost = fit.losses.cost(&fit.iterate.chi2);
    }
    Ok(fit)
}

/// A scale up to this is no evidence of understated noise: the median doubles if 40 % of the edges are wrong.
const MAX_STATED_SCALE: f64 = 2.5;

/// Probability that noise alone makes one of all observations an outlier at any scale.
const FALSE_ALARM: f64 = 1e-3;

/// Ratio of squared residuals to those that the stated noise predicts: 1 if it is right.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Scale {
    edges: f64,
    contacts: f64,
}

impl Scale {
    /// The scale of most observations under a robust `solution`; at least 1.
    fn of(solver: &Solver<'_>, solution: &Solution) -> Self {
        let redundancy = goodness_of_fit(solver, solution).redundancy();
        let median = median_scale(&solver.problem.dimensions, &solution.iterate.chi2);
        // Fitting reduces squared residuals.
        let scale = |median: f64| (median * redundancy).max(1.0);
        Self { edges: scale(median.edges), contacts: scale(median.contacts) }
    }

    /// Whether the median is consistent with the stated noise.
    fn is_as_stated(self) -> bool {
        self.is_as_stated_of_edges() && self.contacts <= MAX_STATED_SCALE
    }

    fn is_as_stated_of_edges(self) -> bool {
        self.edges <= MAX_STATED_SCALE
    }

    fn max(self, other: Self) -> Self {
        Self { edges: self.edges.max(other.edges), contacts: self.contacts.max(other.contacts) }
    }

    fn of_losses(self, losses: &LossFunctions) -> LossFunctions {
        losses.scaled(|_| self.edges, self.contacts)
    }
}

/// The median of squared residuals over that of a chi-square variable, of edges and of contacts; 0
/// without any. Of an even number the lower one, so that half can be wrong; of two the larger,
/// since either can be made to fit.
fn median_scale(dimensions: &PerObservation<usize>, chi2: &PerObservation) -> Scale {
    let medians = quantiles(dimensions, 0.5);
    let relative = dimensions.zip(chi2, |n, chi2| (n > 0).then(|| chi2 / medians[n]));
    let median = |relative: &[Option<f64>]| {
        let observed: Vec<f64> = relative.iter().flatten().copied().collect();
        let half = (observed.len().saturating_sub(1) / 2).max(usize::from(observed.len() > 1));
        nth_smallest(observed, half).unwrap_or(0.0)
    };
    Scale { edges: median(relative.edges.as_slice()), contacts: median(relative.contacts.as_slice()) }
}

/// Whether the squared residual of an observation for which `suspects` is true exceeds `leverage * median
/// scale * chi-square quantile`. Does not depend on the stated noise.
///
/// `leverage` is the factor by which fitting separates suspects from the others.
fn has_outlier(
    dimensions: &PerObservation<usize>,
    leverage: f64,
    chi2: &PerObservation,
    verdicts: &PerObservation<Verdict>,
    suspects: impl Fn(Verdict) -> bool,
) -> bool {
    let count = dimensions.iter().filter(|&n| n > 0).count() as f64;
    let largest = quantiles(dimensions, 1.0 - FALSE_ALARM / count);
    let scale = median_scale(dimensions, chi2);
    let bounds = dimensions.map(|n| if n > 0 { leverage * largest[n] } else { f64::INFINITY });
    // The squares of suspects over their bounds at scale 1; 0 for the others.
    let suspected = chi2.zip(verdicts, |chi2, verdict| if suspects(verdict) { chi2 } else { 0.0 });
    let shares = suspected.zip(&bounds, |chi2, bound| chi2 / bound);
    shares.edges.iter().any(|&x| x > scale.edges) || shares.contacts.iter().any(|&x| x > scale.contacts)
}

/// The quantile of chi-square at `probability` for every dimension that occurs.
fn quantiles(dimensions: &PerObservation<usize>, probability: f64) -> Vec<f64> {
    let most = dimensions.iter().max().unwrap_or(0);
    (0..=most).map(|n| quantile(probability, n.max(1) as f64)).collect()
}
