use glam::DVec3;
use rayon::prelude::*;

use crate::{
    id::{IdVec, VertexId},
    parallel::{par_collect, par_map},
    skin::triangulate::kd_tree::{KdTree, Near},
};

/// The distance to the third nearest taxel is the spacing: on a lattice it is the same inside, on the boundary and
/// at most corners, and thermal pads between taxels do not halve it as they do the distance to the nearest.
const SPACING_RANK: usize = 3;

/// The spacing is the median over a taxel and so many nearest: the ring of a lattice.
const SMOOTHING: usize = 6;

/// A taxel looks at no more neighbours than this, times the square of the gap. A lattice has 3.6, and with thermal pads
/// between its taxels 5; more come from another side of the part, or from a heap of points without a surface.
const CROWD: f64 = 10.0;

/// Which taxels are near each other, and how far apart taxels are there.
#[derive(Debug)]
pub(super) struct Neighbours {
    /// Distance of taxels around each taxel; positive.
    pub spacing: IdVec<VertexId, f64>,
    /// Nearest first.
    lists: Vec<Vec<VertexId>>,
}

impl Neighbours {
    /// Joins taxels that are at most `gap` times the mean of their spacings apart. There must be at least two taxels, all at
    /// different places.
    pub(super) fn new(positions: &IdVec<VertexId, DVec3>, gap: f64) -> Self {
        let tree = KdTree::new(positions);
        let spacing = spacing(&tree, positions);
        let ids: Vec<VertexId> = positions.ids().collect();
        let crowd = crowd(gap);
        let is_within = |v: VertexId, &(squared, w): &Near| {
            let most = gap * 0.5 * (spacing[v] + spacing[w]);
            squared <= most * most
        };
        let near_and_last = |v: VertexId, found: &mut Vec<Near>| {
            let reach = gap * spacing[v];
            tree.nearest(positions[v], v, crowd, reach, found);
            let last = if found.len() < crowd {
                (reach * reach, VertexId::from(u32::MAX))
            } else {
                found[crowd - 1]
            };
            (found.iter().filter(|near| is_within(v, near)).map(|near| near.1).collect(), last)
        };
        let near = par_collect(ids.len(), |range, near| {
            let mut found = Vec::new();
            near.extend(ids[range].iter().map(|&v| near_and_last(v, &mut found)));
        });
        let (mut lists, last): (Vec<Vec<VertexId>>, Vec<Near>) = near.into_iter().unzip();
        // A taxel of dense skin does not look as far as a neighbour in sparse skin, which may have found it.
        let mut missed: Vec<(VertexId, Near)> = par_collect(ids.len(), |range, missed| {
            for &v in &ids[range] {
                let seen = lists[v.index()].iter();
                let seen = seen.map(|&w| (w, (positions[v].distance_squared(positions[w]), v)));
                missed.extend(seen.filter(|(w, near)| is_before(&last[w.index()], near)));
            }
        });
        missed.par_sort_unstable_by(|(v, a), (w, b)| v.cmp(w).then(a.0.total_cmp(&b.0)).then(a.1.cmp(&b.1)));
        // Whatever a taxel has missed is farther away than all that it found.
        missed.into_iter().for_each(|(v, (_, w))| lists[v.index()].push(w));
        Self { spacing, lists }
    }

    /// The same, but only the pairs that `keep` wants; it must not mind the order.
    pub(super) fn filtered(&self, keep: impl Fn(VertexId, VertexId) -> bool + Sync) -> Self {
        let ids: Vec<VertexId> = self.spacing.ids().collect();
        let kept = |&v: &VertexId| self.of(v).iter().copied().filter(|&w| keep(v, w)).collect();
        Self { spacing: self.spacing.clone(), lists: par_map(&ids, kept) }
    }

    /// The neighbours of `v`, nearest first.
    pub(super) fn of(&self, v: VertexId) -> &[VertexId] {
        &self.lists[v.index()]
    }
}

/// Whether `a` is found before `b`.
fn is_before(a: &Near, b: &Near) -> bool {
    a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)).is_lt()
}

/// Most neighbours of a taxel.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "gaps lie between 1 and 20")]
fn crowd(gap: f64) -> usize {
    (CROWD * gap * gap).ceil() as usize
}

/// The distance of a taxel to the third nearest, of those that were found; 1 if it is alone.
pub(super) fn distance_around(nearest: &[Near]) -> f64 {
    nearest.get(SPACING_RANK - 1).or(nearest.last()).map_or(1.0, |near| near.0.sqrt())
}

/// [`distance_around`] of each taxel, smoothed.
fn spacing(tree: &KdTree, positions: &IdVec<VertexId, DVec3>) -> IdVec<VertexId, f64> {
    let ids: Vec<VertexId> = positions.ids().collect();
    let own_and_nearest = |v: VertexId, found: &mut Vec<Near>| {
        tree.nearest(positions[v], v, SMOOTHING, f64::INFINITY, found);
        let mut nearest = [v; SMOOTHING];
        nearest.iter_mut().zip(found.iter()).for_each(|(n, near)| *n = near.1);
        (distance_around(found), nearest)
    };
    let distances = par_collect(ids.len(), |range, distances| {
        let mut found = Vec::new();
        distances.extend(ids[range].iter().map(|&v| own_and_nearest(v, &mut found)));
    });
    let (own, nearest): (Vec<f64>, Vec<[VertexId; SMOOTHING]>) = distances.into_iter().unzip();
    let median = |v: VertexId| {
        let mut around = [own[v.index()]; SMOOTHING + 1];
        around.iter_mut().zip(nearest[v.index()]).for_each(|(s, w)| *s = own[w.index()]);
        around.sort_unstable_by(f64::total_cmp);
        around[SMOOTHING / 2]
    };
    par_map(&ids, |&v| median(v)).into()
}
