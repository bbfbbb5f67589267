use std::cmp::Ordering;

use glam::DVec3;

use crate::id::{IdVec, VertexId};

/// A leaf is searched through: below this, splitting costs more than looking.
const LEAF: usize = 12;

/// Parts of more points are built by two threads.
const PARALLEL: usize = 20_000;

/// A balanced k-d tree (Bentley 1975): the point in the middle of a range of `points` splits it.
///
/// Unlike a grid it does not mind taxels of very different spacing.
#[derive(Debug)]
pub(super) struct KdTree {
    points: Vec<(DVec3, VertexId)>,
    /// Along which axis the point in the middle of its range splits.
    axes: Vec<u8>,
}

/// A neighbour: its squared distance, and which it is.
pub(super) type Near = (f64, VertexId);

impl KdTree {
    pub(super) fn new(positions: &IdVec<VertexId, DVec3>) -> Self {
        let mut points: Vec<_> = positions.enumerate().map(|(v, &p)| (p, v)).collect();
        let mut axes = vec![0; points.len()];
        split(&mut points, &mut axes);
        Self { points, axes }
    }

    /// Writes the `count` points nearest to `at` within `radius` into `found`, nearest first, equally near ones by id; `but` is
    /// not among them.
    pub(super) fn nearest(&self, at: DVec3, but: VertexId, count: usize, radius: f64, found: &mut Vec<Near>) {
        found.clear();
        let mut search = Search { at, but, count, bound: radius * radius, found };
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
    let extent = high - low;
    let axis =
        if extent.x >= extent.y && extent.x >= extent.z { 0 } else { 1 + u8::from(extent.z > extent.y) };
    let middle = points.len() / 2;
    let along = |p: &(DVec3, VertexId)| p.0[usize::from(axis)];
    points.select_nth_unstable_by(middle, |p, q| along(p).total_cmp(&along(q)).then(p.1.cmp(&q.1)));
    axes[middle] = axis;
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

/// What is looked for, and the best found so far, sorted.
struct Search<'a> {
    at: DVec3,
    but: VertexId,
    count: usize,
    /// Squared distance beyond which nothing is wanted.
    bound: f64,
    found: &'a mut Vec<Near>,
}

impl Search<'_> {
    fn offer(&mut self, &(point, id): &(DVec3, VertexId)) {
        let distance = self.at.distance_squared(point);
        if distance > self.bound || id == self.but {
            return;
        }
        let is_before = |near: &Near| near.0.total_cmp(&distance).then(near.1.cmp(&id)) == Ordering::Less;
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
            let mut all: Vec<Near> = positions
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
