//! Goodness of fit: the chi-square test of the inliers.
//!
//! The squares of inliers are below a bound, so they are smaller than those of all observations: their sum is
//! compared with its mean under that bound, that of the truncated chi-square density, `k F_{k+2}(b) / F_k(b)`
//! for `k` numbers and the bound `b`.

use std::collections::HashMap;

use crate::calib::robust::solution::Solution;
use crate::calib::{GoodnessOfFit, Loss, Solver, Verdict, free_components};
use crate::numeric::chi_square_tail;

pub(crate) fn goodness_of_fit(solver: &Solver<'_>, solution: &Solution) -> GoodnessOfFit {
    let (problem, verdicts) = (solver.problem, &solution.verdicts);
    let observations = problem.observations;
    let (chi2, bounds) = (&solution.iterate.chi2, &solution.losses.of);
    let mut sums = Sums::default();
    // A taxel whose observations were all rejected is neither observed nor unknown.
    let mut seen = observations.taxels.map(|_| false);
    let is_inlier = |v: Verdict| v == Verdict::Inlier;
    for (id, edge) in observations.edges.enumerate().filter(|(id, _)| is_inlier(verdicts.edges[*id])) {
        sums.add(chi2.edges[id], problem.dimensions.edges[id], bounds.edges[id].outlier2);
        (seen[edge.from], seen[edge.to]) = (true, true);
    }
    for (id, contact) in observations.contacts.enumerate().filter(|(id, _)| is_inlier(verdicts.contacts[*id]))
    {
        sums.add(chi2.contacts[id], problem.dimensions.contacts[id], bounds.contacts[id].outlier2);
        seen[contact.taxel] = true;
    }
    let moving = seen.enumerate().filter(|(v, seen)| **seen && problem.rows[*v].is_some()).count();
    let unknown = moving * observations.model.unknowns();
    let free = free_components(problem, &solution.iterate.poses, |c| is_inlier(verdicts.contacts[c]));
    let unknown = unknown - free.iter().map(|f| f.free_motions).sum::<usize>().min(unknown);
    let degrees_of_freedom = sums.measurements.saturating_sub(unknown);
    let is_judged = matches!(solution.losses.loss, Loss::Squared | Loss::Truncated);
    let p = is_judged.then(|| chi_square_tail(sums.chi2 / sums.mean_share(), degrees_of_freedom as f64));
    GoodnessOfFit { chi2: sums.chi2, measurements: sums.measurements, degrees_of_freedom, p }
}

#[derive(Default)]
struct Sums {
    chi2: f64,
    measurements: usize,
    /// Mean of the sum of squares under their bounds.
    expected: f64,
    /// Means by dimension and bound: without scaled bounds there are few.
    means: HashMap<(usize, u64), f64>,
}

impl Sums {
    fn add(&mut self, chi2: f64, dimension: usize, bound: f64) {
        self.chi2 += chi2;
        self.measurements += dimension;
        let mean =
            self.means.entry((dimension, bound.to_bits())).or_insert_with(|| mean_below(dimension, bound));
        self.expected += *mean;
    }

    fn mean_share(&self) -> f64 {
        if self.expected > 0.0 { self.expected / self.measurements as f64 } else { 1.0 }
    }
}

/// Mean of a chi-square variable of `degrees` degrees of freedom below `bound`.
fn mean_below(degrees: usize, bound: f64) -> f64 {
    let k = degrees as f64;
    let below = |degrees: f64| 1.0 - chi_square_tail(bound, degrees);
    if bound.is_finite() && degrees > 0 { k * below(k + 2.0) / below(k) } else { k }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two degrees of freedom: the density is `exp(-x / 2) / 2`.
    #[test]
    fn the_mean_below_a_bound_is_that_of_the_cut_density() {
        for q in [0.5_f64, 2.0, 11.0] {
            let tail = (-0.5 * q).exp();
            let expected = (2.0 - tail * (q + 2.0)) / (1.0 - tail);
            let found = mean_below(2, q);
            assert!((found / expected - 1.0).abs() < 1e-12, "{q}: {found} is not {expected}");
        }
        assert_eq!(mean_below(5, f64::INFINITY), 5.0);
    }
}
