//! The noise scale: how much larger the residuals of most observations are than their stated noise
//! predicts, by the median (rousseeuw1987); and the outlier test that holds at any scale.

use crate::calib::{
    LossFunctions, PerObservation, Solver, Verdict,
    robust::{goodness_of_fit::goodness_of_fit, solution::Solution},
};
use crate::numeric::{nth_smallest, quantile};

/// A scale up to this does not show understated noise: the median doubles where 40 % of the edges
/// are wrong.
const AS_STATED: f64 = 2.5;

/// Probability that noise alone makes one of all observations an outlier at any scale.
const BY_CHANCE: f64 = 1e-3;

/// How much larger squared residuals are than the stated noise predicts: 1 where it is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Scale {
    pub(crate) edges: f64,
    pub(crate) contacts: f64,
}

impl Scale {
    /// The scale of most observations under a robust `solution`; at least 1.
    pub(crate) fn of(solver: &Solver<'_>, solution: &Solution) -> Self {
        let redundancy = goodness_of_fit(solver, solution).redundancy();
        let median = median_scale(&solver.problem.dimensions, &solution.iterate.chi2);
        // Fitting makes squared residuals smaller.
        let scale = |median: f64| (median * redundancy).max(1.0);
        Self { edges: scale(median.edges), contacts: scale(median.contacts) }
    }

    /// Whether the stated noise is right as far as a median can show.
    pub(crate) fn is_as_stated(self) -> bool {
        self.is_as_stated_of_edges() && self.contacts <= AS_STATED
    }

    pub(crate) fn is_as_stated_of_edges(self) -> bool {
        self.edges <= AS_STATED
    }

    pub(crate) fn max(self, other: Self) -> Self {
        Self { edges: self.edges.max(other.edges), contacts: self.contacts.max(other.contacts) }
    }

    pub(crate) fn of_losses(self, losses: &LossFunctions) -> LossFunctions {
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
    Scale { edges: median(&relative.edges), contacts: median(&relative.contacts) }
}

/// Whether the squared residual of an observation that `suspects` picks exceeds
/// `leverage * median scale * chi-square quantile`. Does not depend on the stated noise.
///
/// The `leverage` is that by which fitting separates suspects from the others.
pub(crate) fn has_outlier(
    dimensions: &PerObservation<usize>,
    leverage: f64,
    chi2: &PerObservation,
    verdicts: &PerObservation<Verdict>,
    suspects: impl Fn(Verdict) -> bool,
) -> bool {
    let count = dimensions.iter().filter(|&n| n > 0).count() as f64;
    let largest = quantiles(dimensions, 1.0 - BY_CHANCE / count);
    let scale = median_scale(dimensions, chi2);
    let bounds = dimensions.map(|n| if n > 0 { leverage * largest[n] } else { f64::INFINITY });
    // The squares of suspects over their bounds at scale 1; others exceed none.
    let suspected = chi2.zip(verdicts, |chi2, verdict| if suspects(verdict) { chi2 } else { 0.0 });
    let shares = suspected.zip(&bounds, |chi2, bound| chi2 / bound);
    shares.edges.iter().any(|&x| x > scale.edges) || shares.contacts.iter().any(|&x| x > scale.contacts)
}

/// The quantile of chi-square at `probability` for every dimension that occurs.
fn quantiles(dimensions: &PerObservation<usize>, probability: f64) -> Vec<f64> {
    let most = dimensions.iter().max().unwrap_or(0);
    (0..=most).map(|n| quantile(probability, n.max(1) as f64)).collect()
}
