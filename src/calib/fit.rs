use crate::calib::{
    Model, Motion, Touch, chi_square_tail,
    gauge::Free,
    normal_equations::{PerObservation, Problem},
};

/// Whether the stated noise is believable.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// Sum of the squared whitened errors of the observations that were kept.
    pub chi2: f64,
    /// Degrees of freedom: observed numbers minus unknown numbers.
    pub degrees: usize,
    /// Chance of a larger sum if the stated noise is right. Near 0 the noise is understated (or something is wrong),
    /// near 1 overstated.
    pub p: f64,
}

impl Fit {
    /// What a user should think of it, as a sentence.
    #[must_use]
    pub fn verdict(&self) -> &'static str {
        // One calibration in a thousand is called wrong on either side.
        const DOUBTFUL: f64 = 5e-4;
        if self.degrees == 0 {
            "nothing was observed twice, so the noise cannot be judged"
        } else if self.p < DOUBTFUL {
            "the observations disagree by more than the stated noise: it is understated, or some are wrong"
        } else if self.p > 1.0 - DOUBTFUL {
            "the observations agree better than the stated noise lets expect: it is overstated, or they are not independent"
        } else {
            "the stated noise is believable"
        }
    }
}

/// The goodness of fit of the observations that were kept.
pub(super) fn fit(
    problem: &Problem<'_>,
    free: &[Free],
    squares: &PerObservation,
    kept: &PerObservation<bool>,
) -> Fit {
    let observations = problem.observations;
    let (mut chi2, mut observed) = (0.0, 0);
    // A taxel all of whose observations were rejected is neither observed nor unknown.
    let mut seen = observations.taxels.map(|_| false);
    for (id, edge) in observations.edges.enumerate() {
        if kept.edges[id] {
            chi2 += squares.edges[id];
            (seen[edge.from], seen[edge.to]) = (true, true);
            let moves = problem.rows[edge.from].is_some() || problem.rows[edge.to].is_some();
            observed += if moves { edge_rank(&edge.motion) } else { 0 };
        }
    }
    for (id, contact) in observations.contacts.enumerate() {
        if kept.contacts[id] {
            chi2 += squares.contacts[id];
            seen[contact.taxel] = true;
            let moves = problem.rows[contact.taxel].is_some();
            observed += if moves { touch_rank(&contact.touch, observations.model) } else { 0 };
        }
    }
    let moving = seen.enumerate().filter(|(v, seen)| **seen && problem.rows[*v].is_some()).count();
    let unknown = moving * observations.model.unknowns();
    let unknown = unknown - free.iter().map(|f| f.directions).sum::<usize>().min(unknown);
    let degrees = observed.saturating_sub(unknown);
    Fit { chi2, degrees, p: chi_square_tail(chi2, degrees as f64) }
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
