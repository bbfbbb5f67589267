use std::collections::HashMap;

use crate::calib::{
    Model, Motion, Observations, Robust, Touch,
    chi_square::quantile,
    chi_square_tail,
    gauge::Free,
    normal_equations::{PerObservation, Problem},
    search::Found,
};

/// Whether the stated noise is believable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
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

impl Fit {
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
    pub(super) fn redundancy(&self) -> f64 {
        self.observed as f64 / self.degrees.max(1) as f64
    }

    /// Whether the observations disagree by more than the stated noise.
    pub(super) fn is_too_large(&self) -> bool {
        self.p.is_some_and(|p| p < DOUBTFUL)
    }
}

/// The goodness of fit of the observations that were kept.
///
/// Those that are kept because their squares are below a bound have smaller squares than all: their sum is held against
/// its mean under that bound.
pub(super) fn fit(problem: &Problem<'_>, free: &[Free], found: &Found) -> Fit {
    let observations = problem.observations;
    let squares = &found.point.squares;
    let mut sums = Sums::default();
    // A taxel all of whose observations were rejected is neither observed nor unknown.
    let mut seen = observations.taxels.map(|_| false);
    for (id, edge) in observations.edges.enumerate().filter(|(id, _)| found.kept.edges[*id]) {
        sums.add(squares.edges[id], edge_rank(&edge.motion), found.bounds.edges[id]);
        (seen[edge.from], seen[edge.to]) = (true, true);
    }
    for (id, contact) in observations.contacts.enumerate().filter(|(id, _)| found.kept.contacts[*id]) {
        let rank = touch_rank(&contact.touch, observations.model);
        sums.add(squares.contacts[id], rank, found.bounds.contacts[id]);
        seen[contact.taxel] = true;
    }
    let moving = seen.enumerate().filter(|(v, seen)| **seen && problem.rows[*v].is_some()).count();
    let unknown = moving * observations.model.unknowns();
    let unknown = unknown - free.iter().map(|f| f.directions).sum::<usize>().min(unknown);
    let degrees = sums.observed.saturating_sub(unknown);
    let judged = matches!(found.robust, Robust::None | Robust::Graduated);
    let p = judged.then(|| chi_square_tail(sums.chi2 / sums.mean_share(), degrees as f64));
    Fit { chi2: sums.chi2, observed: sums.observed, degrees, p }
}

/// Chance that noise alone makes one of all observations stand out.
const BY_CHANCE: f64 = 1e-3;

/// Whether one of the `suspects` is farther off than noise as large as that of the others would ever make it, whatever noise
/// is stated: held against the median of all squares, times the `lever` by which fitting sets suspects and others apart.
pub(super) fn stands_out(
    observations: &Observations,
    lever: f64,
    squares: &PerObservation,
    suspects: &PerObservation<bool>,
) -> bool {
    let ranks = PerObservation {
        edges: observations.edges.map(|e| edge_rank(&e.motion)),
        contacts: observations.contacts.map(|c| touch_rank(&c.touch, observations.model)),
    };
    let count = ranks.iter().filter(|&rank| rank > 0).count();
    if count == 0 {
        return false;
    }
    let mut levels: HashMap<usize, (f64, f64)> = HashMap::new();
    let mut level = |rank: usize| {
        let find = || {
            let rank = rank as f64;
            (quantile(0.5, rank), quantile(1.0 - BY_CHANCE / count as f64, rank))
        };
        *levels.entry(rank).or_insert_with(find)
    };
    let pairs = || ranks.iter().zip(squares.iter()).filter(|(rank, _)| *rank > 0);
    let mut relative: Vec<f64> = pairs().map(|(rank, square)| square / level(rank).0).collect();
    let middle = *relative.select_nth_unstable_by(count / 2, f64::total_cmp).1;
    let scale = middle * lever;
    suspects
        .iter()
        .zip(ranks.iter().zip(squares.iter()))
        .any(|(suspect, (rank, square))| suspect && rank > 0 && square > scale * level(rank).1)
}

#[derive(Default)]
struct Sums {
    chi2: f64,
    observed: usize,
    /// Mean of the sum of squares under their bounds.
    expected: f64,
    /// Means by rank and bound, of which there are few: most observations are alike.
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

fn edge_rank(motion: &Motion) -> usize {
    match motion {
        Motion::Offset { information, .. } => information.rank(),
        Motion::Relative(m) => m.information.rank(),
    }
}

fn touch_rank(touch: &Touch, model: Model) -> usize {
    match touch {
        Touch::Position { information, .. } => information.rank(),
        Touch::PositionNormal { information, normal_information, .. } => {
            let normal = if model == Model::Poses && *normal_information > 0.0 { 2 } else { 0 };
            information.rank() + normal
        }
        Touch::Pose(prior) => prior.information.rank(),
    }
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
