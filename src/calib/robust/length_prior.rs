use glam::DVec3;

use crate::{
    calib::{
        DisplacementId, DisplacementMeasurement, Observations, solve::loss::KEPT,
        solve::normal_equations::PerObservation,
    },
    id::IdVec,
};

/// How much likelier than others each edge is to be attributed right, as the logarithm of the ratio of odds.
pub(crate) type LogOdds = IdVec<DisplacementId, f64>;

/// Edges of about the same length that are counted on either side. From 10 to 25 the accuracy at 20 % wrong
/// edges is the same to half a percent.
const NEIGHBOURS: usize = 20;

/// The bound of an edge is stretched, squared, by no less and no more than this: lengths may speak for an edge or
/// against it, but its error has a say, too.
const LEAST_STRETCH: f64 = 0.07;
const MOST_STRETCH: f64 = 2.0;

/// Learns from what a first solution `kept` which lengths wrong edges have; `None` if no more were rejected than noise
/// alone gets rejected.
///
/// Taxels that touch one after the other are neighbours, so good displacements are alike; a contact that is attributed
/// to another taxel makes a displacement of any length. On a taxel with three edges of which two are wrong, nothing
/// else tells which. The odds of an edge are those among the edges that are next to it in length, over those
/// among all: no shape of either distribution is assumed, and where wrong edges are as long as good ones, the odds say
/// nothing.
pub(crate) fn attribution_odds(observations: &Observations, kept: &PerObservation<bool>) -> Option<LogOdds> {
    let mut by_length: Vec<(f64, DisplacementId)> =
        observations.edges.enumerate().map(|(e, d)| (length(&d.measurement).length(), e)).collect();
    by_length.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    // Kept edges among the first k.
    let mut kept_before = vec![0_usize];
    for (k, (_, e)) in by_length.iter().enumerate() {
        kept_before.push(kept_before[k] + usize::from(kept.edges[*e]));
    }
    let (edges, all_kept) = (by_length.len(), kept_before[by_length.len()]);
    let rejected = edges - all_kept;
    let by_noise = (1.0 - KEPT) * edges as f64;
    if (rejected as f64) <= by_noise + 3.0 * by_noise.sqrt() + 1.0 || all_kept == 0 {
        return None;
    }
    let share = all_kept as f64 / edges as f64;
    let mut odds = observations.edges.map(|_| 0.0);
    for (k, &(_, e)) in by_length.iter().enumerate() {
        // At either end as many, those that are nearest in rank.
        let first = k.saturating_sub(NEIGHBOURS).min(edges.saturating_sub(2 * NEIGHBOURS + 1));
        let end = (first + 2 * NEIGHBOURS + 1).min(edges);
        // An edge is no witness in its own case; one more with the odds of all keeps them finite.
        let own = usize::from(kept.edges[e]);
        let good = (kept_before[end] - kept_before[first] - own) as f64 + share;
        let all = (end - first) as f64;
        odds[e] = (good / (all - good)).ln() - (share / (1.0 - share)).ln();
    }
    Some(odds)
}

/// What `odds` make of the squared `bound` of an edge, as a factor.
///
/// An edge of squared error `s` is good with odds proportional to `exp(odds - s / 2)`: what its length says for it
/// weighs as much as twice that of squared error.
pub(crate) fn stretch(odds: f64, bound2: f64) -> f64 {
    (1.0 + 2.0 * odds / bound2).clamp(LEAST_STRETCH, MOST_STRETCH)
}

fn length(motion: &DisplacementMeasurement) -> DVec3 {
    match motion {
        DisplacementMeasurement::Offset { offset, .. } => *offset,
        DisplacementMeasurement::Relative(m) => m.pose.position,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calib::{SimulateOptions, simulate};

    /// All edges but those for which `wrong` holds.
    fn all_but(observations: &Observations, wrong: impl Fn(DisplacementId) -> bool) -> PerObservation<bool> {
        PerObservation {
            edges: observations.edges.ids().map(|e| !wrong(e)).collect(),
            contacts: IdVec::new(),
        }
    }

    #[test]
    fn long_edges_are_suspect_where_rejected_ones_are_long() {
        let options = SimulateOptions { outliers: 0.1, ..SimulateOptions::default() };
        let simulation = simulate(&options).unwrap();
        let observations = &simulation.observations;
        let kept = all_but(observations, |e| simulation.outliers.contains(&e));
        let odds = attribution_odds(observations, &kept).unwrap();
        for (e, edge) in observations.edges.enumerate() {
            let length = length(&edge.measurement).length();
            if length < 7e-3 {
                assert!(odds[e] > -1.0, "{length} m: {}", odds[e]);
            } else if length > 15e-3 {
                assert!(odds[e] < -3.0, "{length} m: {}", odds[e]);
            }
        }
    }

    /// Rejections without regard to length: the odds vary by chance alone.
    #[test]
    fn lengths_that_say_nothing_change_little() {
        let observations = simulate(&SimulateOptions::default()).unwrap().observations;
        let kept = all_but(&observations, |e| e.index() % 5 == 0);
        let odds = attribution_odds(&observations, &kept).unwrap();
        let mean = odds.iter().map(|o| o.abs()).sum::<f64>() / odds.len() as f64;
        // Counting 8 of 40 leaves 0.4 on average.
        assert!(mean < 0.5, "{mean}");
    }

    #[test]
    fn as_many_rejections_as_noise_makes_teach_nothing() {
        let observations = simulate(&SimulateOptions::default()).unwrap().observations;
        for modulus in [300, usize::MAX] {
            let kept = all_but(&observations, |e| e.index() % modulus == 1);
            assert_eq!(attribution_odds(&observations, &kept), None);
        }
    }

    #[test]
    fn bounds_stretch_within_limits() {
        assert_eq!(stretch(0.0, 14.0), 1.0);
        assert_eq!(stretch(-100.0, 14.0), LEAST_STRETCH);
        assert_eq!(stretch(100.0, 20.0), MOST_STRETCH);
    }
}
