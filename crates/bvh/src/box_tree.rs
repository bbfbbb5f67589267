//! [`BoxTree`]: a binary tree over boxes, built by obvhs, and its traversals.
//!
//! obvhs joins boxes that are near each other along a Morton curve (PLOC, `(meister2018)`). Where many pairs have
//! the same cost (coincident boxes, boxes of equal size in a row), this joins few of them in each round and
//! builds deep trees. So each box first grows by a small number of its own (`GROWTH`), and a tree that is
//! still too deep is replaced by one that halves the boxes by count.

use std::ops::ControlFlow;

use arrayvec::ArrayVec;
use glam::{DVec3, Vec3A};
use obvhs::{
    aabb::Aabb as Bounds,
    bvh2::{Bvh2, leaf_collapser::collapse, node::Bvh2Node},
    ploc::{PlocBuilder, SortPrecision},
};

use crate::{Aabb, BvhError, Ray, scaling::Scaling};

/// Boxes of one tree, at most.
const MOST: usize = 1 << 30;

/// Largest growth of a box before it is joined with others, as a fraction of the radius of all boxes: 16
/// roundings of `f32`, far less than the differences between boxes.
const GROWTH: f32 = 1e-6;

/// Largest depth of a tree. A million coincident boxes take 40.
const MOST_DEPTH: usize = 64;

/// Boxes in a leaf, at most.
const LEAF: u32 = 4;

/// Cost of a node, in boxes of a leaf: leaves are joined as long as that is cheaper.
const COST: f32 = 3.0;

/// A tree over boxes, in space or in the plane.
///
/// ```
/// use dermatome_bvh::{Aabb, BoxTree};
/// use glam::DVec3;
/// use std::ops::ControlFlow;
///
/// let cube = |x: f64| Aabb { lo: DVec3::splat(x), hi: DVec3::splat(x + 1.0) };
/// let tree = BoxTree::new(&[cube(0.0), cube(0.5), cube(3.0)])?;
/// let mut pairs = Vec::new();
/// tree.each_pair(|i, j| {
///     pairs.push((i.min(j), i.max(j)));
///     ControlFlow::Continue(())
/// });
/// assert_eq!(pairs, [(0, 1)]);
/// # Ok::<(), dermatome_bvh::BvhError>(())
/// ```
#[derive(Debug, Clone)]
pub struct BoxTree {
    boxes: Vec<Aabb>,
    scaling: Scaling,
    /// The root first, and every node before those below it; their boxes are in the units of the scaling,
    /// rounded outwards.
    nodes: Vec<Bvh2Node>,
    /// The boxes of each leaf, contiguous.
    ids: Vec<u32>,
}

impl Default for BoxTree {
    /// A tree over nothing.
    fn default() -> Self {
        Self {
            boxes: Vec::new(),
            scaling: Scaling::new(&Aabb::EMPTY, 0.0),
            nodes: Vec::new(),
            ids: Vec::new(),
        }
    }
}

impl BoxTree {
    /// A tree over boxes; there may be none.
    ///
    /// # Errors
    /// If a box is not finite, or there are too many.
    pub fn new(boxes: &[Aabb]) -> Result<Self, BvhError> {
        let is_box = |b: &Aabb| b.lo.is_finite() && b.hi.is_finite() && b.lo.cmple(b.hi).all();
        if let Some(index) = boxes.iter().position(|b| !is_box(b)) {
            return Err(BvhError::NotABox { index });
        }
        if boxes.len() > MOST {
            return Err(BvhError::TooMany { count: boxes.len(), most: MOST });
        }
        let scaling = scaling_of(boxes);
        let (mut nodes, mut ids) = joined(boxes, &scaling);
        if depth(&nodes) > MOST_DEPTH {
            (nodes, ids) = halved(boxes);
        }
        let mut tree = Self { boxes: boxes.to_vec(), scaling, nodes, ids };
        tree.fit();
        Ok(tree)
    }

    /// Whether there is no box.
    pub fn is_empty(&self) -> bool {
        self.boxes.is_empty()
    }

    /// Moves the boxes and refits the tree, which keeps its topology: cheaper than a new tree, and as fast to
    /// search as long as neighbours stay neighbours. The boxes must be finite. Nothing is allocated.
    pub fn refit(&mut self, moved: impl Fn(usize) -> Aabb) {
        self.boxes.iter_mut().enumerate().for_each(|(k, b)| *b = moved(k));
        self.scaling = scaling_of(&self.boxes);
        self.fit();
    }

    fn fit(&mut self) {
        for index in (0..self.nodes.len()).rev() {
            let node = &self.nodes[index];
            let around = if node.is_leaf() {
                let join = |b: Bounds, id: &u32| b.union(&rounded(&self.scaling, &self.boxes[*id as usize]));
                self.ids(node).iter().fold(Bounds::INVALID, join)
            } else {
                let [a, b] = children(node).map(|k| *self.nodes[k].aabb());
                a.union(&b)
            };
            self.nodes[index].set_aabb(around);
        }
    }

    /// Calls `visit` once with every pair of boxes that touch, until it returns `Break`.
    pub fn each_pair(&self, mut visit: impl FnMut(usize, usize) -> ControlFlow<()>) -> ControlFlow<()> {
        let nodes = &self.nodes;
        let mut offer = |i: usize, j: usize| {
            if self.boxes[i].touches(&self.boxes[j]) { visit(i, j) } else { ControlFlow::Continue(()) }
        };
        let mut open: Vec<[usize; 2]> = if nodes.is_empty() { Vec::new() } else { vec![[0, 0]] };
        while let Some([a, b]) = open.pop() {
            let (left, right) = (&nodes[a], &nodes[b]);
            if a == b {
                if left.is_leaf() {
                    let ids = self.ids(left);
                    (1..ids.len()).try_for_each(|k| {
                        ids[..k].iter().try_for_each(|&i| offer(ids[k] as usize, i as usize))
                    })?;
                } else {
                    let [c, d] = children(left);
                    open.extend([[d, d], [c, c], [c, d]]);
                }
                continue;
            }
            if !touch(left.aabb(), right.aabb()) {
                continue;
            }
            if left.is_leaf() && right.is_leaf() {
                let (ids, others) = (self.ids(left), self.ids(right));
                ids.iter()
                    .try_for_each(|&i| others.iter().try_for_each(|&j| offer(i as usize, j as usize)))?;
            } else if right.is_leaf()
                || (!left.is_leaf() && left.aabb().half_area() >= right.aabb().half_area())
            {
                open.extend(children(left).map(|child| [child, b]));
            } else {
                open.extend(children(right).map(|child| [a, child]));
            }
        }
        ControlFlow::Continue(())
    }

    /// Calls `visit` with every box that may be nearer to `q` than the distance `visit` returned last, at
    /// first `reach` (infinite for no limit); near ones first, approximately.
    pub fn each_near(&self, q: DVec3, mut reach: f64, mut visit: impl FnMut(usize) -> f64) {
        let Self { boxes, scaling, .. } = self;
        if let [only] = boxes.as_slice() {
            if only.least_distance(q) <= reach {
                visit(0);
            }
            return;
        }
        let (local, scale) = (scaling.point(q), scaling.scale);
        let key = |b: &Bounds| exact(b).least_distance(local);
        self.walk(reach * scale, key, |ids| {
            let away = |&id: &u32| (boxes[id as usize].least_distance(q), id as usize);
            let mut order: ArrayVec<(f64, usize), { LEAF as usize }> = ids.iter().map(away).collect();
            order.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
            for (distance, id) in order {
                if distance <= reach {
                    reach = visit(id);
                }
            }
            reach * scale
        });
    }

    /// Calls `visit` with every box that may be within `reach` of `q`, near ones first, approximately, but for those that
    /// `is_skipped`, which is asked again as the search goes on, and of boxes around many of them.
    pub fn each_kept(
        &self,
        q: DVec3,
        reach: f64,
        is_skipped: impl Fn(&Aabb) -> bool,
        mut visit: impl FnMut(usize),
    ) {
        let Self { boxes, scaling, .. } = self;
        let (local, bound) = (scaling.point(q), reach * scaling.scale);
        let key = |b: &Bounds| {
            let b = exact(b);
            let around = Aabb { lo: scaling.world(b.lo), hi: scaling.world(b.hi) };
            if is_skipped(&around) { f64::INFINITY } else { b.least_distance(local) }
        };
        self.walk(bound, key, |ids| {
            let mut kept = ids.iter().map(|&id| id as usize);
            while let Some(id) =
                kept.find(|&id| boxes[id].least_distance(q) <= reach && !is_skipped(&boxes[id]))
            {
                visit(id);
            }
            bound
        });
    }

    /// Calls `visit` with every box that a ray may enter before the distance `visit` returned last, at
    /// first its length; near ones first, approximately.
    pub fn each_along(&self, ray: &Ray, mut visit: impl FnMut(usize) -> f64) {
        let Self { boxes, scaling, .. } = self;
        let (near, skipped) = scaling.nearby(ray);
        let local = scaling.ray(&near);
        let bound = |longest: f64| (longest - skipped) * scaling.scale;
        let mut longest = ray.longest;
        self.walk(
            bound(longest),
            |b| exact(b).entry(&local, local.longest),
            |ids| {
                for id in ids.iter().map(|&id| id as usize) {
                    if boxes[id].entry(ray, longest) < f64::INFINITY {
                        longest = visit(id);
                    }
                }
                bound(longest)
            },
        );
    }

    /// Visits all leaves whose key is not above a bound, the lower of two keys first.
    ///
    /// `key` gives a lower bound for everything in a node, infinite to skip it; `visit` gets the boxes of a
    /// leaf and returns the new bound. Nothing is allocated.
    fn walk(&self, mut bound: f64, key: impl Fn(&Bounds) -> f64, mut visit: impl FnMut(&[u32]) -> f64) {
        let nodes = &self.nodes;
        let Some(root) = nodes.first() else { return };
        let mut stack = ArrayVec::<(f64, usize), MOST_DEPTH>::new();
        let mut at = (key(root.aabb()), 0);
        loop {
            if at.0 <= bound && at.0 < f64::INFINITY {
                let node = &nodes[at.1];
                if node.is_leaf() {
                    bound = visit(self.ids(node));
                } else {
                    let [a, b] = children(node).map(|child| (key(nodes[child].aabb()), child));
                    let (near, far) = if b.0 < a.0 { (b, a) } else { (a, b) };
                    stack.push(far);
                    at = near;
                    continue;
                }
            }
            let Some(next) = stack.pop() else { return };
            at = next;
        }
    }

    fn ids(&self, leaf: &Bvh2Node) -> &[u32] {
        &self.ids[leaf.first_index as usize..][..leaf.prim_count as usize]
    }
}

/// The two nodes below one.
#[inline]
fn children(node: &Bvh2Node) -> [usize; 2] {
    let first = node.first_index as usize;
    [first, first + 1]
}

#[inline]
fn touch(a: &Bounds, b: &Bounds) -> bool {
    !(a.min.cmpgt(b.max) | b.min.cmpgt(a.max)).any()
}

#[inline]
fn exact(b: &Bounds) -> Aabb {
    Aabb { lo: b.min.as_dvec3(), hi: b.max.as_dvec3() }
}

fn scaling_of(boxes: &[Aabb]) -> Scaling {
    let around = boxes.iter().copied().fold(Aabb::EMPTY, Aabb::union);
    let half = 0.5 * around.hi - 0.5 * around.lo;
    Scaling::new(&around, half.max_element())
}

/// A box in the units of a scaling, rounded outwards.
#[inline]
fn rounded(scaling: &Scaling, b: &Aabb) -> Bounds {
    let (lo, hi) = (scaling.point(b.lo).as_vec3a(), scaling.point(b.hi).as_vec3a());
    let step = |v: Vec3A| v.abs() * f32::EPSILON + Vec3A::splat(f32::MIN_POSITIVE);
    Bounds::new(lo - step(lo), hi + step(hi))
}

/// The tree that obvhs makes.
fn joined(boxes: &[Aabb], scaling: &Scaling) -> (Vec<Bvh2Node>, Vec<u32>) {
    let leaf = |(k, b): (u32, &Aabb)| {
        // Multiples of the golden ratio, without whole parts: neighbours differ.
        let part = k.wrapping_mul(0x9e37_79b9) as f32 / u32::MAX as f32;
        let (b, by) = (rounded(scaling, b), Vec3A::splat(GROWTH * part));
        Bvh2Node::new(Bounds::new(b.min - by, b.max + by), 1, k)
    };
    let mut builder = PlocBuilder::new();
    builder.current_nodes = (0..).zip(boxes).map(leaf).collect();
    let mut tree = Bvh2::zeroed(boxes.len());
    tree.primitive_indices = (0..).take(boxes.len()).collect();
    // A cube: flat sets of boxes must not be stretched before they are sorted.
    let all = Bounds::new(Vec3A::splat(-1.0 - 2.0 * GROWTH), Vec3A::splat(1.0 + 2.0 * GROWTH));
    builder.build_ploc_from_leaves::<1, false>(&mut tree, all, SortPrecision::U64, 0);
    collapse(&mut tree, LEAF, COST);
    (tree.nodes, tree.primitive_indices)
}

/// Nodes on the longest path from the root.
fn depth(nodes: &[Bvh2Node]) -> usize {
    let mut depths = vec![1; nodes.len()];
    for (k, node) in nodes.iter().enumerate().filter(|(_, node)| !node.is_leaf()) {
        children(node).into_iter().for_each(|child| depths[child] = depths[k] + 1);
    }
    depths.into_iter().max().unwrap_or(0)
}

/// A tree that halves the boxes by count, along the longest side of the box around their centres.
#[expect(clippy::cast_possible_truncation, reason = "fewer boxes than MOST")]
fn halved(boxes: &[Aabb]) -> (Vec<Bvh2Node>, Vec<u32>) {
    let mut ids: Vec<u32> = (0..boxes.len() as u32).collect();
    let mut nodes = vec![Bvh2Node::default()];
    let mut open = vec![(0, 0..boxes.len())];
    while let Some((index, range)) = open.pop() {
        if range.len() <= LEAF as usize {
            nodes[index] = Bvh2Node::new(Bounds::INVALID, range.len() as u32, range.start as u32);
            continue;
        }
        let part = &mut ids[range.clone()];
        let centre = |id: u32| boxes[id as usize].lo.midpoint(boxes[id as usize].hi);
        let around = Aabb::around(part.iter().map(|&id| centre(id)));
        let axis = (0.5 * around.hi - 0.5 * around.lo).max_position();
        let middle = part.len() / 2;
        part.select_nth_unstable_by(middle, |&i, &j| {
            centre(i)[axis].total_cmp(&centre(j)[axis]).then(i.cmp(&j))
        });
        let first = nodes.len();
        nodes[index].make_inner(first as u32);
        nodes.resize(first + 2, Bvh2Node::default());
        open.push((first, range.start..range.start + middle));
        open.push((first + 1, range.start + middle..range.end));
    }
    (nodes, ids)
}

#[cfg(test)]
mod tests {
    use std::cell::RefCell;

    use glam::DVec2;
    use proptest::prelude::*;

    use super::*;
    use crate::soup::fixed;

    /// Boxes of a size, far from the origin or not, in space or in the plane; some are points, many touch,
    /// and many are the same.
    fn boxes() -> impl Strategy<Value = Vec<Aabb>> {
        let grid = || prop::array::uniform3(0..6_i32);
        let size = prop_oneof![Just(1e-100), Just(1e-3), Just(1.0), Just(1e100)];
        let flat = prop_oneof![Just(DVec3::ONE), Just(DVec3::new(1.0, 1.0, 0.0)), Just(DVec3::X)];
        let shift = prop_oneof![3 => Just(0.0), 1 => Just(1e3), 1 => Just(1e9)];
        (prop::collection::vec((grid(), grid(), 1..4_usize), 0..60), size, flat, shift).prop_map(
            |(corners, size, flat, shift)| {
                let at = |p: [i32; 3]| (DVec3::from(p.map(f64::from)) + shift) * size * flat;
                let around = |(a, b, n): ([i32; 3], [i32; 3], usize)| {
                    vec![Aabb::around([at(a), at(a) + (at(b) - at(a)) * 0.3]); n]
                };
                corners.into_iter().flat_map(around).collect()
            },
        )
    }

    fn sorted(mut found: Vec<usize>) -> Vec<usize> {
        found.sort_unstable();
        found
    }

    proptest! {
        #![proptest_config(fixed(400, 61))]

        #[test]
        fn walks_find_what_brute_force_finds(
            boxes in boxes(),
            moved in boxes(),
            asked in prop::array::uniform3(0..6_i32),
            direction in prop::array::uniform3(-2..3_i32),
        ) {
            let mut tree = BoxTree::new(&boxes).unwrap();
            let count = boxes.len().min(moved.len());
            let mut refitted = BoxTree::new(&boxes[..count]).unwrap();
            refitted.refit(|k| moved[k]);
            for (tree, boxes) in [(&mut tree, &boxes[..]), (&mut refitted, &moved[..count])] {
                let all = boxes.iter().copied().fold(Aabb::EMPTY, Aabb::union);
                let size = if boxes.is_empty() { DVec3::ONE } else { all.hi - all.lo };
                let corner = if boxes.is_empty() { DVec3::ZERO } else { all.lo };
                let q = corner + size * DVec3::from(asked.map(f64::from)) / 5.0;

                let mut pairs = Vec::new();
                let _ = tree.each_pair(|i, j| {
                    pairs.push([i.min(j), i.max(j)]);
                    ControlFlow::Continue(())
                });
                pairs.sort_unstable();
                let touching = |j: usize| (0..j).filter(move |&i| boxes[i].touches(&boxes[j])).map(move |i| [i, j]);
                let mut expected: Vec<_> = (0..boxes.len()).flat_map(touching).collect();
                expected.sort_unstable();
                prop_assert_eq!(pairs, expected);

                // Boxes within the rounding may be visited or not.
                let rounding = 1e-12 * (q.length() + size.length());
                let away = |k: usize| q.distance(q.clamp(boxes[k].lo, boxes[k].hi));
                let reach = 0.3 * size.max_element();
                let mut found = Vec::new();
                tree.each_near(q, reach, |id| { found.push(id); reach });
                let found = sorted(found);
                prop_assert!(found.iter().all(|&k| away(k) <= reach + rounding || boxes.len() == 1));
                prop_assert!((0..boxes.len()).all(|k| away(k) > reach - rounding || found.contains(&k)));
                // What is skipped later is skipped with all that lies in it.
                let (seen, wall) = (RefCell::new(Vec::new()), q.x + 0.2 * size.x);
                let is_skipped = |b: &Aabb| !seen.borrow().is_empty() && b.lo.x > wall;
                tree.each_kept(q, reach, is_skipped, |id| seen.borrow_mut().push(id));
                let seen = seen.into_inner();
                prop_assert!(seen.iter().skip(1).all(|&k| found.contains(&k) && boxes[k].lo.x <= wall));
                let is_kept = |k: &usize| away(*k) < reach - rounding && boxes[*k].lo.x < wall - rounding;
                prop_assert!((0..boxes.len()).filter(is_kept).all(|k| seen.contains(&k)));
                let mut nearest = f64::INFINITY;
                tree.each_near(q, f64::INFINITY, |id| { nearest = away(id).min(nearest); nearest });
                let expected = (0..boxes.len()).map(away).fold(f64::INFINITY, f64::min);
                prop_assert!(nearest <= expected + rounding || boxes.is_empty());

                let direction = DVec3::from(direction.map(f64::from));
                if let Some(ray) = Ray::new(q, direction, f64::INFINITY) {
                    let mut found = Vec::new();
                    tree.each_along(&ray, |id| { found.push(id); f64::INFINITY });
                    let is_met = |b: &Aabb| b.entry(&ray, f64::INFINITY) < f64::INFINITY;
                    let inner = |b: &Aabb| {
                        let middle = b.lo.midpoint(b.hi);
                        Aabb { lo: (b.lo + rounding).min(middle), hi: (b.hi - rounding).max(middle) }
                    };
                    prop_assert!(found.iter().all(|&k| is_met(&boxes[k])));
                    let is_clear = |k: usize| boxes[k].lo.distance(boxes[k].hi) > 4.0 * rounding;
                    let is_missed = |k: &usize| is_clear(*k) && is_met(&inner(&boxes[*k])) && !found.contains(k);
                    prop_assert_eq!((0..boxes.len()).find(is_missed), None);
                }
            }
        }
    }

    /// Unit cubes in a row, three apart, far from the origin.
    fn row(count: usize, shift: f64) -> Vec<Aabb> {
        let corner = |k: usize| DVec3::new(shift + 3.0 * k as f64, 0.0, 0.0);
        (0..count).map(|k| Aabb::around([corner(k), corner(k) + DVec3::ONE])).collect()
    }

    #[test]
    fn the_nearest_box_is_visited_first() {
        for count in [13, 20, 300] {
            let tree = BoxTree::new(&row(count, 1e6)).unwrap();
            let q = DVec3::new(1e6 + 33.5, 0.5, 2.0);
            let mut visited = Vec::new();
            tree.each_near(q, f64::INFINITY, |id| {
                visited.push(id);
                4.0
            });
            assert_eq!(visited[0], 11, "its box is nearest");
            assert_eq!(sorted(visited), [10, 11, 12], "boxes within 4 m");
            tree.each_near(q, 0.5, |id| unreachable!("{id} is 1 m away"));
        }
    }

    #[test]
    fn rays_visit_the_boxes_they_meet() {
        for count in [13, 300] {
            let tree = BoxTree::new(&row(count, 0.0)).unwrap();
            let visited = |origin: DVec3, direction: DVec3, longest: f64| {
                let mut visited = Vec::new();
                tree.each_along(&Ray::new(origin, direction, longest).unwrap(), |id| {
                    visited.push(id);
                    longest
                });
                sorted(visited)
            };
            let (middle, inf) = (DVec3::splat(0.5), f64::INFINITY);
            assert_eq!(visited(middle, DVec3::X, inf).len(), count);
            assert_eq!(visited(middle - 1e9 * DVec3::X, DVec3::X, inf).len(), count);
            assert_eq!(visited(middle, -DVec3::X, inf), [0]);
            assert_eq!(visited(middle - DVec3::X, DVec3::X, 7.0), [0, 1, 2]);
            assert_eq!(visited(middle + 9.0 * DVec3::X - DVec3::Y, DVec3::Y, inf), [3]);
            assert_eq!(visited(DVec3::new(6.0, 0.0, 9.0), -DVec3::Z, inf), [2], "along an edge");
            assert!(visited(middle + 2.0 * DVec3::Y, DVec3::X, inf).is_empty());
        }
    }

    /// Boxes that cost the same to join are joined in a few rounds, and the tree stays shallow.
    #[test]
    fn boxes_in_a_row_and_coincident_boxes_make_no_deep_tree() {
        let flat = |k: u32, step: f64| Aabb::flat([DVec2::new(f64::from(k) * step, 0.0); 2]);
        for step in [0.0, 1.0, 0.1, 1e-12] {
            let boxes: Vec<_> = (0..50_000).map(|k| flat(k, step)).collect();
            let (nodes, _) = joined(&boxes, &scaling_of(&boxes));
            assert!(depth(&nodes) < 48, "{} levels of boxes {step} apart", depth(&nodes));
        }
    }

    #[test]
    fn halving_by_count_finds_the_same_boxes() {
        let boxes: Vec<_> = [row(40, 0.0), row(30, 0.5), vec![Aabb::flat([DVec2::ONE]); 50]].concat();
        let tree = BoxTree::new(&boxes).unwrap();
        let mut other = tree.clone();
        (other.nodes, other.ids) = halved(&boxes);
        other.fit();
        assert!(depth(&other.nodes) < 9);
        let pairs = |tree: &BoxTree| {
            let mut pairs = Vec::new();
            let _ = tree.each_pair(|i, j| {
                pairs.push([i.min(j), i.max(j)]);
                ControlFlow::Continue(())
            });
            pairs.sort_unstable();
            pairs
        };
        assert_eq!(pairs(&tree), pairs(&other));
    }

    #[test]
    fn invalid_boxes_are_refused() {
        let ok = Aabb::flat([DVec2::ZERO, DVec2::ONE]);
        let nan = Aabb { hi: DVec3::new(1.0, f64::NAN, 1.0), ..ok };
        let infinite = Aabb { lo: DVec3::NEG_INFINITY, ..ok };
        for bad in [nan, infinite, Aabb::EMPTY, Aabb { lo: DVec3::X * 2.0, ..ok }] {
            assert_eq!(BoxTree::new(&[ok, bad]).unwrap_err(), BvhError::NotABox { index: 1 });
        }
    }
}
