use std::collections::HashMap;

use crate::calib::{
    Robust,
    robust::automatic::Found,
    solve::gauge::Anchoring,
    solve::loss::Scale,
    solve::normal_equations::{PerObservation, Problem},
};
use crate::numeric::{chi_square_tail, quantile};

/// Whether the stated noise is believable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GoodnessOfFit {
    /// Sum of the squared whitened errors of the observations that were kept.
    pub chi2: f64,
    /// Numbers that were observed by those.
    pub observed: usize,
    /// Degrees of freedom: observed numbers minus unknown numbers.
    pub degrees: usize,
    /// Chance of a larger sum if the stated noise is right. Near 0 the noise is understated (or something is wrong),
    /// near 1 overstated. `None` under a kernel that weighs good observations, too: the sum is then no chi-square.
    pub p: Option<f64>,
}

/// One calibration in a thousand is called wrong, on either side.
const DOUBTFUL: f64 = 5e-4;

/// Chi-square over degrees of freedom that differs from 1 by less says that the noise is stated to within 1 %: among a
/// million observations chance excludes even that, but no user cares.
const NEGLIGIBLE: f64 = 0.02;

impl GoodnessOfFit {
    /// What a user should think of it, as a sentence.
    #[must_use]
    pub fn verdict(&self) -> &'static str {
        let Some(p) = self.p else {
            return "this kernel weighs good observations, too, so the noise cannot be judged; none and gnc judge it";
        };
        if self.degrees == 0 {
            "no more is observed than is unknown, so the noise cannot be judged"
        } else if (self.chi2 / self.degrees as f64 - 1.0).abs() < NEGLIGIBLE {
            "the stated noise is believable"
        } else if self.is_too_large() {
            "the observations disagree by more than the stated noise: it is understated, or some are wrong"
        } else if p > 1.0 - DOUBTFUL {
            "the observations agree better than the stated noise lets expect: it is overstated, or they are not independent"
        } else {
            "the stated noise is believable"
        }
    }

    /// Observed numbers over degrees of freedom: what fitting takes from the squares of errors.
    pub(crate) fn redundancy(&self) -> f64 {
        self.observed as f64 / self.degrees.max(1) as f64
    }

    /// Whether the observations disagree by more than the stated noise.
    pub(crate) fn is_too_large(&self) -> bool {
        self.p.is_some_and(|p| p < DOUBTFUL)
    }
}

/// The goodness of fit of the observations that were kept.
///
/// Those that are kept because their squares are below a bound have smaller squares than all: their sum is held against
/// its mean under that bound.
pub(crate) fn fit(problem: &Problem<'_>, anchoring: &Anchoring, found: &Found) -> GoodnessOfFit {
    let observations = problem.observations;
    let (squares, bounds) = (&found.point.squares, found.kernels.bounds());
    let mut sums = Sums::default();
    // A taxel all of whose observations were rejected is neither observed nor unknown.
    let mut seen = observations.taxels.map(|_| false);
    for (id, edge) in observations.edges.enumerate().filter(|(id, _)| found.kept.edges[*id]) {
        sums.add(squares.edges[id], problem.ranks.edges[id], bounds.edges[id]);
        (seen[edge.from], seen[edge.to]) = (true, true);
    }
    for (id, contact) in observations.contacts.enumerate().filter(|(id, _)| found.kept.contacts[*id]) {
        sums.add(squares.contacts[id], problem.ranks.contacts[id], bounds.contacts[id]);
        seen[contact.taxel] = true;
    }
    let moving = seen.enumerate().filter(|(v, seen)| **seen && problem.rows[*v].is_some()).count();
    let unknown = moving * observations.model.unknowns();
    let free = anchoring.free(problem, &found.point.state, |contact| found.kept.contacts[contact]);
    let unknown = unknown - free.iter().map(|f| f.directions).sum::<usize>().min(unknown);
    let degrees = sums.observed.saturating_sub(unknown);
    let judged = matches!(found.kernels.robust, Robust::None | Robust::Graduated);
    let p = judged.then(|| chi_square_tail(sums.chi2 / sums.mean_share(), degrees as f64));
    GoodnessOfFit { chi2: sums.chi2, observed: sums.observed, degrees, p }
}

/// Chance that noise alone makes one of all observations stand out.
const BY_CHANCE: f64 = 1e-3;

/// The median of squared errors over that of a chi-square variable, of edges and of contacts; 0 without any. Of an even number
/// the lower one, so that half can be wrong; of two the larger, since either can be made to fit.
pub(crate) fn middle(ranks: &PerObservation<usize>, squares: &PerObservation) -> Scale {
    let mut medians = ByRank::new(|rank| quantile(0.5, rank));
    let mut middle = |ranks: &[usize], squares: &[f64]| {
        let observed = ranks.iter().zip(squares).filter(|(rank, _)| **rank > 0);
        let mut relative: Vec<f64> = observed.map(|(&rank, square)| square / medians.of(rank)).collect();
        let half = (relative.len().saturating_sub(1) / 2).max(usize::from(relative.len() > 1));
        if relative.is_empty() { 0.0 } else { *relative.select_nth_unstable_by(half, f64::total_cmp).1 }
    };
    Scale {
        edges: middle(ranks.edges.as_slice(), squares.edges.as_slice()),
        contacts: middle(ranks.contacts.as_slice(), squares.contacts.as_slice()),
    }
}

/// Whether one of the `suspects` is farther off than noise as large as that of others of its kind would ever make it,
/// whatever noise is stated: held against the median square of all edges, or of all contacts, times the `lever` by which
/// fitting sets suspects and others apart.
pub(crate) fn stands_out(
    ranks: &PerObservation<usize>,
    lever: f64,
    squares: &PerObservation,
    suspects: &PerObservation<bool>,
) -> bool {
    let count = ranks.iter().filter(|&rank| rank > 0).count() as f64;
    let mut farthest = ByRank::new(|rank| quantile(1.0 - BY_CHANCE / count, rank));
    let mut any = |middle: f64, ranks: &[usize], squares: &[f64], suspects: &[bool]| {
        let observed =
            ranks.iter().zip(squares).zip(suspects).filter(|((rank, _), suspect)| **suspect && **rank > 0);
        observed.into_iter().any(|((&rank, &square), _)| square > lever * middle * farthest.of(rank))
    };
    let middle = middle(ranks, squares);
    any(middle.edges, ranks.edges.as_slice(), squares.edges.as_slice(), suspects.edges.as_slice())
        || any(
            middle.contacts,
            ranks.contacts.as_slice(),
            squares.contacts.as_slice(),
            suspects.contacts.as_slice(),
        )
}

/// A number for every rank, found once.
struct ByRank<F> {
    find: F,
    known: Vec<Option<f64>>,
}

impl<F: Fn(f64) -> f64> ByRank<F> {
    fn new(find: F) -> Self {
        Self { find, known: Vec::new() }
    }

    fn of(&mut self, rank: usize) -> f64 {
        if self.known.len() <= rank {
            self.known.resize(rank + 1, None);
        }
        *self.known[rank].get_or_insert_with(|| (self.find)(rank as f64))
    }
}

#[derive(Default)]
struct Sums {
    chi2: f64,
    observed: usize,
    /// Mean of the sum of squares under their bounds.
    expected: f64,
    /// Means by rank and bound: without stretched bounds there are few.
    means: HashMap<(usize, u64), f64>,
}

impl Sums {
    fn add(&mut self, square: f64, rank: usize, bound: f64) {
        self.chi2 += square;
        self.observed += rank;
        let mean = self.means.entry((rank, bound.to_bits())).or_insert_with(|| mean_below(rank, bound));
        self.expected += *mean;
    }

    fn mean_share(&self) -> f64 {
        if self.expected > 0.0 { self.expected / self.observed as f64 } else { 1.0 }
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
