//! The map of taxels from their signals alone, next to the true one.

use glam::DVec2;

use crate::id::{IdVec, VertexId};
use crate::map::{MapLevel, SkinMap};
use crate::pyramid::LevelId;
use crate::signal::order::embed::embed;
use crate::signal::order::likeness::Likeness;
use crate::skin::PatchId;

/// Fewer taxels of a patch have no map from signals.
const LEAST_TAXELS: usize = 4;

/// Where the signals of a patch put its taxels: the nearer, the more alike their signals are.
#[derive(Debug, Clone, PartialEq)]
pub struct SignalMap {
    /// The place of each taxel, in m, turned, mirrored and scaled to be nearest to the true map; `None` of one that is
    /// not touched, or whose signals are not connected with most others.
    pub points: IdVec<VertexId, Option<DVec2>>,
    /// Root mean square distance of these from the true map, in m.
    pub rms: f64,
}

/// The maps of all patches from the likeness of their taxels, which are counted through the patches; `None` of a patch
/// of which fewer than four are touched.
pub(super) fn signal_maps(map: &SkinMap, likeness: &Likeness) -> IdVec<PatchId, Option<SignalMap>> {
    let mut first = 0;
    map.patches.map(|patch| {
        let count = patch.taxels.ids.len();
        let range = first..first + count;
        first += count;
        let level = patch.levels.get(LevelId::new(0))?;
        let own: Vec<usize> = (0..likeness.len()).filter(|&k| range.contains(&likeness.columns[k])).collect();
        let likeness = likeness.select(&own);
        let embedding = embed(&likeness);
        if embedding.members.len() < LEAST_TAXELS {
            return None;
        }
        let taxel = |&member: &usize| VertexId::new(likeness.columns[member] - range.start);
        let taxels: Vec<VertexId> = embedding.members.iter().map(taxel).collect();
        let true_points = true_points(level, count);
        let targets: Vec<DVec2> = taxels.iter().map(|&taxel| true_points[taxel]).collect();
        let (fitted, rms) = fit(&embedding.points, &targets);
        let mut points = IdVec::filled(None, count);
        taxels.into_iter().zip(fitted).for_each(|(taxel, point)| points[taxel] = Some(point));
        Some(SignalMap { points, rms })
    })
}

/// The place of each taxel on its map; of those on a seam the first one.
fn true_points(level: &MapLevel, count: usize) -> IdVec<VertexId, DVec2> {
    let mut points = IdVec::filled(DVec2::ZERO, count);
    let mut is_known: IdVec<VertexId, bool> = IdVec::filled(false, count);
    for (place, &uv) in level.uv.enumerate() {
        let vertex = level.vertex_of(place);
        if !std::mem::replace(&mut is_known[vertex], true) {
            points[vertex] = uv;
        }
    }
    points
}

/// Points turned, mirrored, scaled and moved to be nearest to targets, and the root mean square distance that is left.
fn fit(points: &[DVec2], targets: &[DVec2]) -> (Vec<DVec2>, f64) {
    let n = points.len() as f64;
    let [from, to] = [points, targets].map(|all| all.iter().sum::<DVec2>() / n);
    // A turn with a scale is a product of complex numbers.
    let product = |mirror: f64| -> DVec2 {
        let pairs = points.iter().zip(targets);
        pairs
            .map(|(x, y)| (*y - to).rotate(((*x - from) * DVec2::new(1.0, mirror)) * DVec2::new(1.0, -1.0)))
            .sum()
    };
    let square: f64 = points.iter().map(|x| x.distance_squared(from)).sum();
    let mirror = if product(-1.0).length() > product(1.0).length() { -1.0 } else { 1.0 };
    let turn = product(mirror) / square.max(f64::MIN_POSITIVE);
    let fitted: Vec<DVec2> =
        points.iter().map(|x| to + turn.rotate((*x - from) * DVec2::new(1.0, mirror))).collect();
    let left: f64 = fitted.iter().zip(targets).map(|(x, y)| x.distance_squared(*y)).sum();
    (fitted, (left / n).sqrt())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turned_and_mirrored_points_are_fitted() {
        let targets: Vec<DVec2> =
            (0..12_i32).map(|k| DVec2::new(f64::from(k % 4), f64::from(k * k % 7))).collect();
        for mirror in [1.0, -1.0] {
            let turn = DVec2::new(0.3, -2.0);
            let moved = |x: &DVec2| turn.rotate(*x * DVec2::new(1.0, mirror)) + DVec2::new(5.0, 1.0);
            let points: Vec<DVec2> = targets.iter().map(moved).collect();
            let (fitted, rms) = fit(&points, &targets);
            assert!(rms < 1e-12, "{rms}");
            assert!(fitted.iter().zip(&targets).all(|(x, y)| x.distance(*y) < 1e-12));
        }
    }
}
