//! Neighbours on a link, what differences they share, and how much differences usually spread.

use glam::DVec3;

use crate::bvh::PointTree;
use crate::id::VertexId;
use crate::numeric::{DEVIATION_OF_MEDIAN, median_of};
use crate::parallel::par_map;

/// Nearest taxels with which a taxel is compared.
const NEIGHBOURS: usize = 12;

/// The 90 % quantile of the sizes of normal numbers.
const NORMAL_QUANTILE: f64 = 1.644_854;

/// Degrees of freedom of a variance from the median of the sizes of 3 components of each difference, over their number:
/// it is 37 % as good as that from their squares.
const DEGREES_OF_MEDIAN: f64 = 3.0 * 0.37;

/// Differences from which their spread is estimated.
const LEAST_DIFFERENCES: usize = 8;

/// The nearest others of each position.
pub(super) fn neighbours(positions: &[DVec3]) -> Vec<Vec<usize>> {
    let tree = PointTree::new(positions, |_| DVec3::ZERO);
    let all: Vec<usize> = (0..positions.len()).collect();
    par_map(&all, |&k| {
        let mut found: Vec<(VertexId, f64)> = Vec::new();
        tree.nearest(positions[k], NEIGHBOURS + 1, f64::INFINITY, &mut found);
        let others = found.into_iter().map(|(other, _)| other.index()).filter(|&other| other != k);
        others.take(NEIGHBOURS).collect()
    })
}

/// What differences share: their mean along each axis, of the middle half; 0 without any.
pub(super) fn shared(differences: impl Iterator<Item = DVec3> + Clone) -> DVec3 {
    let along = |axis: usize| {
        let mut all: Vec<f64> = differences.clone().map(|d| d[axis]).collect();
        all.sort_unstable_by(f64::total_cmp);
        let cut = all.len() / 4;
        let middle = &all[cut..all.len() - cut];
        middle.iter().sum::<f64>() / (middle.len() as f64).max(1.0)
    };
    DVec3::new(along(0), along(1), along(2))
}

/// The variance of [`shared`] over that of one of `count` independent normal differences: of a mean of the middle half.
pub(super) fn variance_of_shared(count: usize) -> f64 {
    1.2 / (count as f64).max(1.0)
}

/// How much differences spread over what is expected of each of them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spread {
    /// The standard deviation, from the median of components.
    pub(super) sigma: f64,
    /// One plus twice the relative uncertainty of it.
    pub(super) uncertainty: f64,
    /// The degrees of freedom of its square.
    pub(super) degrees: f64,
}

impl Spread {
    /// Enlarged by its own uncertainty.
    pub(super) fn enlarged(self) -> f64 {
        self.sigma * self.uncertainty
    }
}

/// The spread of differences; `None` of too few. Those of which 0 is expected do not count.
pub(super) fn spread(differences: impl Iterator<Item = (DVec3, f64)>) -> Option<Spread> {
    let (mut sizes, uncertainty) = sizes(differences)?;
    let degrees = DEGREES_OF_MEDIAN * (sizes.len() / 3) as f64;
    Some(Spread { sigma: DEVIATION_OF_MEDIAN * median_of(&mut sizes)?, uncertainty, degrees })
}

/// The same of differences that do not all spread alike: from their 90 % quantile if that gives more. Modules tilt more
/// where a calibration knows less of the normals, which the expected number does not say.
pub(super) fn uneven_spread(differences: impl Iterator<Item = (DVec3, f64)> + Clone) -> Option<Spread> {
    let (mut sizes, uncertainty) = sizes(differences.clone())?;
    let place = sizes.len() * 9 / 10;
    let large = *sizes.select_nth_unstable_by(place, f64::total_cmp).1 / NORMAL_QUANTILE;
    let found = spread(differences)?;
    Some(Spread { sigma: found.sigma.max(large), uncertainty, ..found })
}

/// Sizes of components over what was expected, and one plus twice the relative uncertainty of their spread.
fn sizes(differences: impl Iterator<Item = (DVec3, f64)>) -> Option<(Vec<f64>, f64)> {
    let known = differences.filter(|(_, expected)| *expected > 0.0);
    let sizes: Vec<f64> = known.flat_map(|(d, expected)| (d / expected).abs().to_array()).collect();
    let count = sizes.len() / 3;
    (count >= LEAST_DIFFERENCES).then(|| (sizes, 1.0 + 2.0 / (count as f64).sqrt()))
}
