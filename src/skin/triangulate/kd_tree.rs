//! A k-d tree of points for nearest-neighbour searches (bentley1975).

use std::cmp::Ordering;

use glam::DVec3;

use crate::id::{IdVec, VertexId};

/// Points in a leaf, which is searched linearly: smaller leaves cost more than they save.
const LEAF: usize = 12;

/// Larger subtrees are built by two threads.
const PARALLEL: usize = 20_000;

/// A balanced k-d tree: the middle point of a range of `points` splits it.
///
/// Unlike a grid it stays fast where the spacing of taxels varies by orders of magnitude.
#[derive(Debug)]
pub(super) struct KdTree {
    points: Vec<(DVec3, VertexId)>,
    /// The axis along which the middle point of its range splits.
    axes: Vec<u8>,
}

/// Squared distance and id of a point that was found.
pub(super) type Neighbour = (f64, VertexId);

impl KdTree {
    pub(super) fn new(positions: &IdVec<VertexId, DVec3>) -> Self {
        let mut points: Vec<_> = positions.enumerate().map(|(v, &p)| (p, v)).collect();
        let mut axes = vec![0; points.len()];
        split(&mut points, &mut axes);
        Self { points, axes }
    }

    /// Writes the `count` points nearest to `at` within `radius` into `found`, nearest first, ties
    /// by id, without `excluded`.
    pub(super) fn nearest(
        &self,
        at: DVec3,
        excluded: VertexId,
        count: usize,
        radius: f64,
        found: &mut Vec<Neighbour>,
    ) {
        found.clear();
        let mut search = Search { at, excluded, count, bound: radius * radius, found };
        if count > 0 {
            self.visit(0, self.points.len(), &mut search);
        }
    }

    fn visit(&self, from: usize, to: usize, search: &mut Search<'_>) {
        if to - from <= LEAF {
            self.points[from..to].iter().for_each(|point| search.offer(point));
            return;
        }
        let middle = from.midpoint(to);
        let axis = usize::from(self.axes[middle]);
        let beyond = search.at[axis] - self.points[middle].0[axis];
        let (near, far) = if beyond < 0.0 {
            ((from, middle), (middle + 1, to))
        } else {
            ((middle + 1, to), (from, middle))
        };
        self.visit(near.0, near.1, search);
        search.offer(&self.points[middle]);
        if beyond * beyond <= search.bound {
            self.visit(far.0, far.1, search);
        }
    }
}

fn split(points: &mut [(DVec3, VertexId)], axes: &mut [u8]) {
    if points.len() <= LEAF {
        return;
    }
    let (low, high) = points
        .iter()
        .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(low, high), (p, _)| (low.min(*p), high.max(*p)));
    let middle = points.len() / 2;
    let axis = (high - low).max_position();
    let along = |p: &(DVec3, VertexId)| p.0[axis];
    points.select_nth_unstable_by(middle, |p, q| along(p).total_cmp(&along(q)).then(p.1.cmp(&q.1)));
    axes[middle] = if axis == 0 { 0 } else { 1 + u8::from(axis == 2) };
    let (low_points, rest) = points.split_at_mut(middle);
    let (low_axes, rest_axes) = axes.split_at_mut(middle);
    let parts = ((low_points, low_axes), (&mut rest[1..], &mut rest_axes[1..]));
    if parts.0.0.len() > PARALLEL {
        rayon::join(|| split(parts.0.0, parts.0.1), || split(parts.1.0, parts.1.1));
    } else {
        split(parts.0.0, parts.0.1);
        split(parts.1.0, parts.1.1);
    }
}

/// A running search, and the best points so far, sorted.
struct Search<'a> {
    at: DVec3,
    excluded: VertexId,
    count: usize,
    /// Squared distance beyond which points are ignored.
    bound: f64,
    found: &'a mut Vec<Neighbour>,
}

impl Search<'_> {
    fn offer(&mut self, &(point, id): &(DVec3, VertexId)) {
        let distance = self.at.distance_squared(point);
        if distance > self.bound || id == self.excluded {
            return;
        }
        let is_before =
            |near: &Neighbour| near.0.total_cmp(&distance).then(near.1.cmp(&id)) == Ordering::Less;
        let place = self.found.partition_point(is_before);
        if place == self.count {
            return;
        }
        if self.found.len() == self.count {
            self.found.pop();
        }
        self.found.insert(place, (distance, id));
        if self.found.len() == self.count {
            self.bound = self.found[self.count - 1].0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn the_tree_finds_what_a_look_at_all_points_finds() {
        let positions = shapes::saddle(20).positions;
        let tree = KdTree::new(&positions);
        let mut found = Vec::new();
        for (v, &p) in positions.enumerate() {
            let mut all: Vec<Neighbour> = positions
                .enumerate()
                .filter(|(w, _)| *w != v)
                .map(|(w, q)| (p.distance_squared(*q), w))
                .collect();
            all.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            tree.nearest(p, v, 9, f64::INFINITY, &mut found);
            assert_eq!(found, all[..9], "the nearest nine of vertex {v}");
            tree.nearest(p, v, usize::MAX, 0.02, &mut found);
            let within = all.iter().filter(|near| near.0 <= 0.02 * 0.02).count();
            assert_eq!(found, all[..within], "all within 2 cm of vertex {v}");
        }
    }
}
