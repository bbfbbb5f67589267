//! The rigid motion that most of some pairs of points follow.

use std::collections::HashSet;

use glam::{DMat3, DQuat, DVec3};

use crate::calib::{Correlation, Pose, nearest_rotation};
use crate::numeric::{MEDIAN_OF_MAXWELL, Random, bits, median_of};

/// Triples of pairs from which motions are tried: with half of the pairs wrong, one in eight triples is right.
const TRIPLES: usize = 100;

/// Rounds of Tukey's biweight `(beaton1974)`, and its limit over the standard deviation.
const ROUNDS: usize = 15;
const LIMIT: f64 = 4.685;

/// The motion from the first points to the second that most pairs follow, and the median distance that it leaves:
/// the best of motions of all pairs and of some triples, refined with Tukey's weights. `least` is the smallest
/// distance that matters, in m. Of fewer than three pairs only a translation can be found. Pairs from the same place
/// count once: files give several slots the centre of their module.
pub(super) fn common_motion(pairs: &[(DVec3, DVec3)], least: f64) -> (Pose, f64) {
    let mut seen = HashSet::new();
    let is_first = |(from, _): &&(DVec3, DVec3)| seen.insert(bits(from.to_array()));
    let pairs = &pairs.iter().filter(is_first).copied().collect::<Vec<_>>()[..];
    let mut best = motion(pairs, None);
    // Without outliers nothing is better: of few pairs a triple may fit half of them by chance, far from the truth.
    if pairs.iter().all(|&(from, to)| best.apply(from).distance(to) < LIMIT * least) {
        let left = median_left(&best, pairs, &mut Vec::new());
        return (best, left);
    }
    let mut distances = Vec::with_capacity(pairs.len());
    let mut left = median_left(&best, pairs, &mut distances);
    let mut consider = |candidate: Pose| {
        let candidate_left = median_left(&candidate, pairs, &mut distances);
        if candidate_left < left {
            (best, left) = (candidate, candidate_left);
        }
    };
    consider(Pose::default());
    let mut random = Random::new(0, 0);
    for _ in 0..if pairs.len() > 3 { TRIPLES } else { 0 } {
        let triple = [(); 3].map(|()| pairs[random.below(pairs.len())]);
        consider(motion(&triple, None));
    }
    for _ in 0..ROUNDS {
        let limit = LIMIT * (left / MEDIAN_OF_MAXWELL).max(least);
        let weight = |&(from, to): &(DVec3, DVec3)| {
            let ratio = best.apply(from).distance(to) / limit;
            (1.0 - ratio * ratio).max(0.0).powi(2)
        };
        let weights: Vec<f64> = pairs.iter().map(weight).collect();
        if weights.iter().filter(|&&w| w > 0.0).count() < pairs.len().min(3) {
            break;
        }
        best = motion(pairs, Some(&weights));
        left = median_left(&best, pairs, &mut distances);
    }
    (best, left)
}

fn median_left(motion: &Pose, pairs: &[(DVec3, DVec3)], distances: &mut Vec<f64>) -> f64 {
    distances.clear();
    distances.extend(pairs.iter().map(|&(from, to)| motion.apply(from).distance(to)));
    median_of(distances).unwrap_or(0.0)
}

/// The motion that is best in the sum of squares. Turns that the points do not determine are left out.
fn motion(pairs: &[(DVec3, DVec3)], weights: Option<&[f64]>) -> Pose {
    let Correlation { from, to, matrix } = Correlation::new(pairs, weights);
    let size = matrix.to_cols_array().iter().map(|x| x.abs()).sum::<f64>();
    let rotation = if pairs.len() < 3 || size == 0.0 {
        DQuat::IDENTITY
    } else {
        nearest_rotation(&(matrix + 1e-9 * size * DMat3::IDENTITY))
    };
    Pose { position: to - rotation * from, rotation }
}
