//! [`PointTree`]: the nearest few of many points, and all within a sphere.

use std::cmp::Ordering;
use std::ops::ControlFlow;

use glam::DVec3;

use crate::Aabb;
use crate::descent::{Descent, Visitor, bound_of};
use crate::lanes::{Kernel, Lanes, Simd};
use crate::packets::Point8;
use crate::scaling::{FAR, FAR_ROUND_UP, Scaling, slack, squared_bound_f32};
use crate::tree::{Points, Primitive, Tree, distinct, put};

/// A tree over points.
///
/// ```
/// use dermatome_bvh::PointTree;
/// use glam::DVec3;
///
/// let tree = PointTree::new(&[DVec3::ZERO, DVec3::X, DVec3::Y], |_| DVec3::Z);
/// let mut found: Vec<(u32, f64)> = Vec::new();
/// tree.nearest(DVec3::new(0.9, 0.0, 0.0), 2, f64::INFINITY, &mut found);
/// assert_eq!(found.iter().map(|&(id, _)| id).collect::<Vec<_>>(), [1, 0]);
/// ```
#[derive(Debug, Clone)]
pub struct PointTree {
    points: Vec<DVec3>,
    tree: Option<Tree>,
    /// One for each packet of the tree.
    packets: Vec<Point8>,
    scaling: Scaling,
    simd: Simd,
}

/// The type of the ids of points in answers.
pub trait Id: Copy + Ord + From<u32> + Into<u32> {}

impl<I: Copy + Ord + From<u32> + Into<u32>> Id for I {}

/// Searches for more points run in `f64`, point by point.
const MOST: usize = 64;

/// A smaller buffer makes searches for up to this many points faster.
const FEW: usize = 8;

impl PointTree {
    /// A tree over finite points; there may be none. The normals of the skin there, of any length, turn
    /// its boxes; they may be 0.
    pub fn new(points: &[DVec3], normal: impl Fn(usize) -> DVec3) -> Self {
        let scaling = Scaling::around(points.iter().copied());
        let primitive = |(k, p): (usize, &DVec3)| Primitive { centre: scaling.point(*p), area: normal(k) };
        let primitives: Vec<_> = points.iter().enumerate().map(primitive).collect();
        let tree = (!points.is_empty()).then(|| Tree::new(&primitives));
        let count = tree.as_ref().map_or(0, |tree| tree.packets.len());
        let packets = vec![Point8::default(); count];
        let mut all = Self { points: points.to_vec(), tree, packets, scaling, simd: Simd::detect() };
        all.fit(normal);
        all
    }

    /// Moves the points and fits the tree to them, which keeps its shape. Nothing is allocated.
    pub fn refit(&mut self, point: impl Fn(usize) -> DVec3, normal: impl Fn(usize) -> DVec3) {
        for (k, p) in self.points.iter_mut().enumerate() {
            *p = point(k);
        }
        self.scaling = Scaling::around(self.points.iter().copied());
        self.fit(normal);
    }

    fn fit(&mut self, normal: impl Fn(usize) -> DVec3) {
        let Self { points, tree, packets, scaling, simd } = self;
        let Some(tree) = tree else { return };
        let at = |id: u32| scaling.point(points[id as usize]);
        tree.fit(*simd, |packet, ids, points: &mut Points<1>| {
            packets[packet] = Point8::new(&ids.map(at));
            ids.iter().enumerate().for_each(|(lane, &id)| put(points, lane, [at(id)]));
            ids.iter().map(|&id| normal(id as usize)).sum()
        });
    }

    /// The box of its points.
    pub fn bounds(&self) -> Aabb {
        self.scaling.bounds
    }

    /// The positions of the points.
    pub fn points(&self) -> &[DVec3] {
        &self.points
    }

    /// Appends the `k` points nearest to `q`, none farther than `reach` (infinite for no limit), with the
    /// squares of their distances, the nearest first; of equally near ones the first.
    #[inline]
    pub fn nearest<I: Id>(&self, q: DVec3, k: usize, reach: f64, found: &mut Vec<(I, f64)>) {
        let Some(tree) = self.tree.as_ref().filter(|_| k > 0 && q.is_finite()) else { return };
        let local = self.scaling.point(q);
        if k > MOST || local.length() > FAR {
            return self.nearest_in_f64(tree, q, k, reach, found);
        }
        let first = found.len();
        if k <= FEW {
            self.simd.run(Walk::<I, FEW> { points: self, tree, local, k, reach, found });
        } else {
            self.simd.run(Walk::<I, MOST> { points: self, tree, local, k, reach, found });
        }
        for (id, squared) in &mut found[first..] {
            *squared = self.points[(*id).into() as usize].distance_squared(q);
        }
        found[first..].sort_unstable_by(nearer);
        let near = found[first..].iter().take(k).take_while(|(_, squared)| *squared <= reach * reach);
        found.truncate(first + near.count());
    }

    fn nearest_in_f64<I: Id>(&self, tree: &Tree, q: DVec3, k: usize, reach: f64, found: &mut Vec<(I, f64)>) {
        let local = self.scaling.point(q);
        let first = found.len();
        let mut most = reach * reach;
        tree.walk(
            reach * self.scaling.scale * FAR_ROUND_UP,
            |node| node.point_gaps(local),
            |packet| {
                for id in distinct(packet) {
                    let squared = self.points[id as usize].distance_squared(q);
                    if squared <= most {
                        found.push((I::from(id), squared));
                    }
                    // Not at each point: that would sort many of them repeatedly.
                    if found.len() - first >= k.saturating_mul(2) {
                        most = found[first..].select_nth_unstable_by(k - 1, nearer).1.1;
                        found.truncate(first + k);
                    }
                }
                most.sqrt() * self.scaling.scale * FAR_ROUND_UP
            },
        );
        found[first..].sort_unstable_by(nearer);
        found.truncate(first.saturating_add(k));
    }

    /// Appends every point in a sphere with its distance from the centre, in the order of the points.
    pub fn within<I: Id>(&self, centre: DVec3, radius: f64, found: &mut Vec<(I, f64)>) {
        let before = found.len();
        let _ = self.each_within(centre, radius, |id, distance| {
            found.push((id, distance));
            ControlFlow::Continue(())
        });
        found[before..].sort_unstable_by_key(|&(id, _)| id);
    }

    /// Calls `visit` with every point in a sphere and its distance from the centre, near ones first, approximately, until
    /// it breaks.
    pub fn each_within<I: Id>(
        &self,
        centre: DVec3,
        radius: f64,
        mut visit: impl FnMut(I, f64) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        let Some(tree) = &self.tree else { return ControlFlow::Continue(()) };
        let local = self.scaling.point(centre);
        let bound = radius * self.scaling.scale * FAR_ROUND_UP;
        let mut flow = ControlFlow::Continue(());
        tree.walk(
            bound,
            |node| node.point_gaps(local),
            |packet| {
                flow = distinct(packet).try_for_each(|id| {
                    let distance = self.points[id as usize].distance(centre);
                    if distance <= radius { visit(I::from(id), distance) } else { ControlFlow::Continue(()) }
                });
                // No node is as near, so the walk ends.
                if flow.is_break() { f64::NEG_INFINITY } else { bound }
            },
        );
        flow
    }
}

/// The order of answers: by distance, equally far ones by id.
fn nearer<I: Ord>(a: &(I, f64), b: &(I, f64)) -> Ordering {
    a.1.total_cmp(&b.1).then(a.0.cmp(&b.0))
}

/// The traversal with eight lanes: leaves in `found` everything that may be among the nearest `k`, at most `N`.
struct Walk<'a, I, const N: usize> {
    points: &'a PointTree,
    tree: &'a Tree,
    local: DVec3,
    k: usize,
    reach: f64,
    found: &'a mut Vec<(I, f64)>,
}

impl<I: Id, const N: usize> Kernel for Walk<'_, I, N> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self { points, tree, local, k, reach, found } = self;
        let slack = slack(local.length(), 1.0);
        let bound = squared_bound_f32(reach * points.scaling.scale, slack);
        let mut descent = Descent::new(l, tree, local.as_vec3().to_array(), bound);
        let first = found.len();
        let mut squares = [f32::MAX; N];
        squares[..N - k].fill(f32::NEG_INFINITY);
        let mut nearest = Nearest { points, tree, slack, squares, found };
        descent.run(&mut nearest);
        let mut kept = first;
        for n in first..found.len() {
            if found[n].1 <= f64::from(descent.bound) {
                found[kept] = found[n];
                kept += 1;
            }
        }
        found.truncate(kept);
    }
}

struct Nearest<'a, I, const N: usize> {
    points: &'a PointTree,
    tree: &'a Tree,
    slack: f64,
    /// The least squared distances, one for each wanted point, ascending, after smaller numbers.
    squares: [f32; N],
    /// Points and their squares.
    found: &'a mut Vec<(I, f64)>,
}

impl<L: Lanes, I: Id, const N: usize> Visitor<L> for Nearest<'_, I, N> {
    #[inline(always)]
    fn visit(&mut self, l: L, point: [f32; 3], packet: usize, bound: &mut f32) {
        let ids = &self.tree.packets[packet];
        let squared = self.points.packets[packet].distance_squared(l, point);
        let mut mask = l.le(squared, l.splat(*bound));
        if mask == 0 {
            return;
        }
        let squared = l.store(squared);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize & 7;
            mask &= mask - 1;
            // Empty lanes repeat the last point.
            if lane > 0 && ids[lane] == ids[lane - 1] {
                break;
            }
            let square = squared[lane];
            self.found.push((I::from(ids[lane]), f64::from(square)));
            // Without a branch: its position is unpredictable.
            let before = self.squares;
            for slot in 0..N {
                let lower = if slot == 0 { f32::NEG_INFINITY } else { before[slot - 1] };
                let least = if lower > square { lower } else { square };
                self.squares[slot] = if before[slot] < least { before[slot] } else { least };
            }
        }
        if self.squares[N - 1] < f32::MAX {
            *bound = bound.min(bound_of(self.squares[N - 1], self.slack));
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::soup;

    proptest! {
        #![proptest_config(soup::fixed(300, 34))]

        #[test]
        fn nearest_and_contained_points_are_those_of_brute_force(
            points in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 0..300),
            copies in 0_usize..100,
            q in prop::array::uniform3(-2.0_f64..2.0),
            away in prop_oneof![5 => Just(1.0), 1 => Just(1e5), 1 => Just(1e9)],
            k in prop_oneof![4 => 0_usize..20, 1 => 60_usize..70, 1 => 90_usize..500, 1 => Just(usize::MAX)],
            reach in prop_oneof![2 => Just(f64::INFINITY), 1 => Just(0.3)],
        ) {
            let mut points: Vec<DVec3> = points.into_iter().map(DVec3::from).collect();
            points.extend(vec![DVec3::ONE * 0.5; copies]);
            let (tree, q) = (PointTree::new(&points, |v| points[v]), DVec3::from(q) * away);
            let mut expected: Vec<_> = (0_u32..).zip(&points).map(|(k, p)| (k, p.distance_squared(q))).collect();
            expected.retain(|&(_, squared)| squared <= reach * reach);
            expected.sort_by(|a, b| (a.1, a.0).partial_cmp(&(b.1, b.0)).unwrap());
            expected.truncate(k);
            let mut found = Vec::new();
            tree.nearest(q, k, reach, &mut found);
            prop_assert_eq!(&found, &expected);

            for radius in [0.0, 0.2, 0.8, 1e9] {
                let all = (0_u32..).zip(&points).map(|(k, p)| (k, p.distance(q)));
                let expected: Vec<_> = all.filter(|&(_, distance)| distance <= radius).collect();
                found.clear();
                tree.within(q, radius, &mut found);
                prop_assert_eq!(&found, &expected);

                // Points are visited until one that is wanted.
                let is_wanted = |k: u32| k % 7 == 3;
                let mut visited = Vec::new();
                let flow = tree.each_within(q, radius, |k: u32, _| {
                    visited.push(k);
                    if is_wanted(k) { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
                });
                prop_assert_eq!(flow.is_break(), expected.iter().any(|&(k, _)| is_wanted(k)));
                prop_assert_eq!(visited.iter().filter(|k| is_wanted(**k)).count(), usize::from(flow.is_break()));
            }
        }
    }
}
