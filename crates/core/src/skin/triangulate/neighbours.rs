//! The point cloud: the spacing of taxels, and which of them may be joined.
//!
//! *Heuristic*: the constants are measured on lattices, on iCub and CySkin layouts.

use glam::DVec3;

use crate::bvh::PointTree;
use crate::id::{IdVec, VertexId};
use crate::mesh::triangle_cross;
use crate::parallel::{par_collect, par_ids};

/// The distance to the third nearest taxel is the spacing: on a lattice it is the same inside, on the
/// boundary and at most corners, and thermal pads between taxels do not halve it as they halve the distance
/// to the nearest.
const SPACING_RANK: usize = 3;

/// The spacing is the median over a taxel and this many nearest: the ring of a lattice.
const SMOOTHING_NEIGHBOURS: usize = 6;

/// A taxel has at most this many neighbours, times the square of the gap. A lattice has 3.6, and with thermal
/// pads between its taxels 5; more come from another side of the body, or from points that are not on a
/// surface.
const MAX_NEIGHBOURS: f64 = 10.0;

/// A taxel that was found, and its squared distance in m^2.
pub(super) type Neighbour = (VertexId, f64);

pub(super) fn tree_of(positions: &IdVec<VertexId, DVec3>) -> PointTree {
    PointTree::new(positions.as_slice(), |_| DVec3::ZERO)
}

/// Writes the `count` taxels nearest to `v` within `radius` into `found`, nearest first, ties by id.
pub(super) fn nearest_others(
    tree: &PointTree,
    v: VertexId,
    count: usize,
    radius: f64,
    found: &mut Vec<Neighbour>,
) {
    found.clear();
    tree.nearest(tree.points()[v.index()], count + 1, radius, found);
    found.retain(|near| near.0 != v);
    found.truncate(count);
}

/// The taxels within the gap of each taxel, and the local spacing.
#[derive(Debug)]
pub(super) struct Neighbours {
    /// Local distance between taxels; positive.
    pub spacing: IdVec<VertexId, f64>,
    /// Nearest first.
    lists: Vec<Vec<VertexId>>,
}

impl Neighbours {
    /// Joins taxels that are at most `gap` times the mean of their spacings apart. There must be at least two
    /// taxels, all at different positions.
    pub(super) fn new(positions: &IdVec<VertexId, DVec3>, gap: f64) -> Self {
        let tree = tree_of(positions);
        let spacing = spacing(&tree, positions);
        let count = positions.len();
        let max_neighbours = max_neighbours(gap);
        let is_within = |v: VertexId, &(w, squared): &Neighbour| {
            let most = gap * 0.5 * (spacing[v] + spacing[w]);
            squared <= most * most
        };
        let lists = par_collect(count, |range, lists| {
            let mut found = Vec::new();
            for v in range.map(VertexId::new) {
                nearest_others(&tree, v, max_neighbours, gap * spacing[v], &mut found);
                lists.push(found.iter().filter(|near| is_within(v, near)).map(|near| near.0).collect());
            }
        });
        Self { spacing, lists }
    }

    /// The pairs for which `keep` holds; it must be symmetric.
    pub(super) fn filtered(&self, keep: impl Fn(VertexId, VertexId) -> bool + Sync) -> Self {
        let kept = |v: VertexId| self.of(v).iter().copied().filter(|&w| keep(v, w)).collect();
        Self { spacing: self.spacing.clone(), lists: par_ids(self.spacing.len(), kept).into() }
    }

    /// The neighbours of `v`, nearest first.
    pub(super) fn of(&self, v: VertexId) -> &[VertexId] {
        &self.lists[v.index()]
    }
}

/// The largest number of neighbours of a taxel.
#[expect(clippy::cast_possible_truncation, reason = "gaps lie between 1 and 20")]
fn max_neighbours(gap: f64) -> usize {
    (MAX_NEIGHBOURS * gap * gap).ceil() as usize
}

/// The distance of a taxel to the third nearest of those found; 1 if it is alone.
pub(super) fn distance_around(nearest: &[Neighbour]) -> f64 {
    nearest.get(SPACING_RANK - 1).or(nearest.last()).map_or(1.0, |near| near.1.sqrt())
}

/// [`distance_around`] of each taxel, smoothed.
fn spacing(tree: &PointTree, positions: &IdVec<VertexId, DVec3>) -> IdVec<VertexId, f64> {
    let own_and_nearest = |v: VertexId, found: &mut Vec<Neighbour>| {
        nearest_others(tree, v, SMOOTHING_NEIGHBOURS, f64::INFINITY, found);
        let mut nearest = [v; SMOOTHING_NEIGHBOURS];
        nearest.iter_mut().zip(found.iter()).for_each(|(n, near)| *n = near.0);
        (distance_around(found), nearest)
    };
    let distances = par_collect(positions.len(), |range, distances| {
        let mut found = Vec::new();
        distances.extend(range.map(|k| own_and_nearest(VertexId::new(k), &mut found)));
    });
    let (own, nearest): (Vec<f64>, Vec<[VertexId; SMOOTHING_NEIGHBOURS]>) = distances.into_iter().unzip();
    par_ids(positions.len(), |v: VertexId| {
        let mut around = [own[v.index()]; SMOOTHING_NEIGHBOURS + 1];
        around.iter_mut().zip(nearest[v.index()]).for_each(|(s, w)| *s = own[w.index()]);
        around.sort_unstable_by(f64::total_cmp);
        around[SMOOTHING_NEIGHBOURS / 2]
    })
}

/// The taxels before there are triangles.
#[derive(Debug, Clone, Copy)]
pub(super) struct PointCloud<'a> {
    pub positions: &'a IdVec<VertexId, DVec3>,
    /// Unit normals; those of neighbours point to the same side.
    pub normals: &'a IdVec<VertexId, DVec3>,
    pub neighbours: &'a Neighbours,
    /// Longest edge allowed, over the spacing.
    pub gap: f64,
}

impl PointCloud<'_> {
    pub(super) fn is_within_gap(&self, v: VertexId, w: VertexId) -> bool {
        let spacing = 0.5 * (self.neighbours.spacing[v] + self.neighbours.spacing[w]);
        self.positions[v].distance(self.positions[w]) <= self.gap * spacing
    }

    /// Unit normal of a triangle; zero if it has no area.
    pub(super) fn normal(&self, t: [VertexId; 3]) -> DVec3 {
        triangle_cross(t.map(|v| self.positions[v])).normalize_or_zero()
    }

    pub(super) fn circumradius(&self, t: [VertexId; 3]) -> f64 {
        let [a, b, c] = t.map(|v| self.positions[v]);
        let (x, y, z) = (b - a, c - b, a - c);
        x.length() * y.length() * z.length() / (2.0 * x.cross(y).length())
    }
}
