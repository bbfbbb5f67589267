//! Neighbours on a link, what differences they share, and how much differences usually spread.

use glam::DVec3;

use crate::numeric::{DEVIATION_OF_MEDIAN, median_of};

/// Nearest taxels with which a taxel is compared.
const NEIGHBOURS: usize = 12;

/// The 90 % quantile of the sizes of normal numbers.
const NORMAL_QUANTILE: f64 = 1.644_854;

/// Differences from which their spread is estimated.
const LEAST_DIFFERENCES: usize = 8;

/// The nearest others of each position.
pub(super) fn neighbours(positions: &[DVec3]) -> Vec<Vec<usize>> {
    let nearest = |k: usize| {
        let distance = |&other: &usize| positions[k].distance_squared(positions[other]);
        let mut others: Vec<usize> = (0..positions.len()).filter(|&other| other != k).collect();
        if others.len() > NEIGHBOURS {
            others.select_nth_unstable_by(NEIGHBOURS, |a, b| {
                distance(a).total_cmp(&distance(b)).then(a.cmp(b))
            });
            others.truncate(NEIGHBOURS);
        }
        others
    };
    (0..positions.len()).map(nearest).collect()
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

/// The standard deviation of differences over what was expected of each of them, from the median of their components,
/// and enlarged by its own uncertainty; `None` of too few.
pub(super) fn spread(differences: impl Iterator<Item = (DVec3, f64)>) -> Option<f64> {
    let (mut sizes, uncertainty) = sizes(differences)?;
    Some(DEVIATION_OF_MEDIAN * median_of(&mut sizes)? * uncertainty)
}

/// The same of differences that do not all spread alike: from their 90 % quantile if that gives more. Modules tilt more
/// where a calibration knows less of the normals, which the expected number does not say.
pub(super) fn uneven_spread(differences: impl Iterator<Item = (DVec3, f64)> + Clone) -> Option<f64> {
    let (mut sizes, uncertainty) = sizes(differences.clone())?;
    let place = sizes.len() * 9 / 10;
    let large = *sizes.select_nth_unstable_by(place, f64::total_cmp).1 / NORMAL_QUANTILE;
    Some(spread(differences)?.max(large * uncertainty))
}

/// Sizes of components over what was expected, and one plus the relative uncertainty of their spread.
fn sizes(differences: impl Iterator<Item = (DVec3, f64)>) -> Option<(Vec<f64>, f64)> {
    let sizes: Vec<f64> = differences.flat_map(|(d, expected)| (d / expected).abs().to_array()).collect();
    let count = sizes.len() / 3;
    (count >= LEAST_DIFFERENCES).then(|| (sizes, 1.0 + 2.0 / (count as f64).sqrt()))
}
