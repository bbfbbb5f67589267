//! Where columns may be on the skin: their map from signals, turned, mirrored and bent onto that of the taxels.
//!
//! *Heuristic*: each turn and mirror image is judged by the distances to the nearest points; the best ones that differ
//! are assigned and bent, step by step.

use std::f64::consts::{PI, TAU};

use glam::DVec2;

use crate::numeric::{argsort, assign, symmetric_eigen};
use crate::parallel::par_map;
use crate::run::{Cancelled, Run};

/// Turns that are tried, each also mirrored.
const TURNS: u32 = 60;

/// How many of them are bent, and how far their turns differ at least, in rad.
const TRIED: usize = 6;
const APART: f64 = 0.5;

/// Alignments that go on.
const KEPT: usize = 4;

/// Assignments, after each of which the points move half of the way to a quadratic fit.
const BENDS: usize = 8;

/// Columns placed on the map of the taxels.
#[derive(Debug, Clone)]
pub(super) struct Start {
    /// Mean square distance of points from the taxels that they are assigned to, and of known ones from theirs.
    pub(super) cost: f64,
    pub(super) points: Vec<DVec2>,
    pub(super) taxels: Vec<usize>,
}

/// The best alignments of points with targets, which both have the mean 0, the best first; the best without known ones
/// is among them. `known` are points and their targets.
pub(super) fn align(
    points: &[DVec2],
    targets: &[DVec2],
    known: &[(usize, usize)],
    run: Run<'_>,
) -> Result<Vec<Start>, Cancelled> {
    let square =
        |points: &[DVec2]| points.iter().map(|x| x.length_squared()).sum::<f64>() / points.len() as f64;
    let factor = (square(targets) / square(points).max(f64::MIN_POSITIVE)).sqrt();
    let turned = |(turn, mirror): (f64, f64)| -> Vec<DVec2> {
        let turn = DVec2::from_angle(turn);
        points.iter().map(|&x| turn.rotate(factor * x * DVec2::new(1.0, mirror))).collect()
    };
    let of_known = |points: &[DVec2]| {
        let all = known.iter().map(|&(point, target)| points[point].distance_squared(targets[target]));
        all.sum::<f64>() / known.len().max(1) as f64
    };
    let turns = |mirror: f64| (0..TURNS).map(move |k| (TAU * f64::from(k) / f64::from(TURNS), mirror));
    let all: Vec<(f64, f64)> = turns(1.0).chain(turns(-1.0)).collect();
    let costs = par_map(&all, |&way| {
        let points = turned(way);
        let plain = to_nearest(&points, targets) + to_nearest(targets, &points);
        [plain, plain + of_known(&points)]
    });
    run.step()?;
    let [plain, whole] = [0, 1].map(|k| argsort(&costs.iter().map(|cost| cost[k]).collect::<Vec<_>>()));
    // Known points may be wrong: what is best without them is tried too.
    let ranked = plain.into_iter().take(1).chain(whole);
    let mut tried: Vec<(f64, f64)> = Vec::new();
    for (turn, mirror) in ranked.map(|k| all[k]) {
        let differs = |other: &(f64, f64)| {
            other.1 != mirror || ((turn - other.0 + PI).rem_euclid(TAU) - PI).abs() > APART
        };
        if tried.len() < TRIED && tried.iter().all(differs) {
            tried.push((turn, mirror));
        }
    }
    let mut starts = par_map(&tried, |&way| {
        let (mut points, mut taxels) = (turned(way), Vec::new());
        for step in 0..=BENDS {
            run.step()?;
            let squares: Vec<f64> =
                points.iter().flat_map(|x| targets.iter().map(|y| x.distance_squared(*y))).collect();
            taxels = assign(&squares, targets.len());
            if step < BENDS {
                points = bent(&points, &taxels.iter().map(|&k| targets[k]).collect::<Vec<_>>());
            }
        }
        let sum: f64 = points.iter().zip(&taxels).map(|(x, &k)| x.distance_squared(targets[k])).sum();
        let cost = sum / points.len() as f64 + of_known(&points);
        Ok(Start { cost, points, taxels })
    })
    .into_iter()
    .collect::<Result<Vec<_>, _>>()?;
    starts.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    let plain = |start: &Start| start.cost - of_known(&start.points);
    let best = (0..starts.len()).min_by(|&a, &b| plain(&starts[a]).total_cmp(&plain(&starts[b])));
    if let Some(best) = best.filter(|&best| best >= KEPT) {
        starts.swap(KEPT - 1, best);
    }
    starts.truncate(KEPT);
    Ok(starts)
}

/// The mean square distance of points from the nearest of others.
fn to_nearest(points: &[DVec2], others: &[DVec2]) -> f64 {
    let nearest = |x: &DVec2| others.iter().map(|y| x.distance_squared(*y)).fold(f64::INFINITY, f64::min);
    points.iter().map(nearest).sum::<f64>() / points.len() as f64
}

/// Points half of the way to the quadratic function of them that is nearest to their targets.
fn bent(points: &[DVec2], targets: &[DVec2]) -> Vec<DVec2> {
    /// Terms of lower eigenvalues depend on the others up to rounding.
    const LEAST: f64 = 1e-12;
    let size = points.iter().map(|x| x.length_squared()).sum::<f64>() / points.len() as f64;
    let unit = 1.0 / size.sqrt().max(f64::MIN_POSITIVE);
    let terms = |x: &DVec2| {
        let x = unit * *x;
        [1.0, x.x, x.y, x.x * x.x, x.y * x.y, x.x * x.y]
    };
    let (mut matrix, mut rhs) = ([[0.0; 6]; 6], [DVec2::ZERO; 6]);
    for (x, y) in points.iter().zip(targets) {
        let own = terms(x);
        for i in 0..6 {
            (0..6).for_each(|j| matrix[i][j] += own[i] * own[j]);
            rhs[i] += own[i] * *y;
        }
    }
    let (values, vectors) = symmetric_eigen(&matrix);
    let most = values.iter().copied().fold(0.0, f64::max);
    let mut fit = [DVec2::ZERO; 6];
    for k in (0..6).filter(|&k| values[k] > LEAST * most) {
        let along: DVec2 = (0..6).map(|i| vectors[i][k] * rhs[i]).sum();
        (0..6).for_each(|i| fit[i] += vectors[i][k] / values[k] * along);
    }
    let of = |x: &DVec2| 0.5 * *x + 0.5 * terms(x).iter().zip(&fit).map(|(t, c)| *t * *c).sum::<DVec2>();
    points.iter().map(of).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points that are turned, mirrored and bent come back to their targets, given known ones.
    #[test]
    fn turned_points_come_back() {
        let mut targets: Vec<DVec2> = (0..56_i32)
            .map(|k| DVec2::new(f64::from(k % 8) - 3.5, f64::from(k / 8) - 3.0))
            .filter(|x| x.x + x.y < 4.0)
            .collect();
        let mean = targets.iter().sum::<DVec2>() / targets.len() as f64;
        targets.iter_mut().for_each(|x| *x -= mean);
        let turn = DVec2::from_angle(2.1);
        let bend = |x: &DVec2| 3.0 * turn.rotate(DVec2::new(x.x + 0.01 * x.y * x.y, -x.y));
        let points: Vec<DVec2> = targets.iter().map(bend).collect();
        let known = [(0, 0), (7, 7), (40, 40)];
        let starts = align(&points, &targets, &known, Run::default()).unwrap();
        assert_eq!(starts[0].taxels, (0..targets.len()).collect::<Vec<_>>());
        assert_eq!(starts.len(), KEPT);
    }
}
