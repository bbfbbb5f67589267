//! Points (taxels, fields) in a tree: the nearest few, and all within a sphere.

use std::cmp::Ordering;

use glam::DVec3;

use super::{
    descent::{Descent, Visitor, bound_of},
    fit::{Points, put},
    frame::Frame,
    lanes::{Kernel, Lanes, Simd},
    point8::Point8,
    rounding::{FAR, FAR_ROUND_UP, slack, squared_bound_f32},
    tree::{Primitive, Tree, distinct},
};
use crate::{
    bvh::Aabb,
    id::{IdVec, VertexId},
    mesh::TriMesh,
};

/// Points of one patch, in m in the frame of its link.
#[derive(Debug, Clone)]
pub(in crate::contact) struct PointTree {
    points: IdVec<VertexId, DVec3>,
    tree: Option<Tree>,
    /// One for each packet of the tree.
    packets: Vec<Point8>,
    frame: Frame,
    simd: Simd,
}

/// More points than this are looked for in `f64`, one by one.
const MOST: usize = 64;

/// Up to this many points are kept in order faster.
const FEW: usize = 8;

impl PointTree {
    /// A tree over finite points; there may be none. The normals of the skin there, of any length, turn
    /// its boxes; they may be 0.
    pub(in crate::contact) fn new(
        points: &IdVec<VertexId, DVec3>,
        normal: impl Fn(VertexId) -> DVec3,
    ) -> Self {
        let frame = Frame::around(points.iter().copied());
        let primitive = |v| Primitive { centre: frame.point(points[v]), area: normal(v) };
        let primitives: Vec<_> = points.ids().map(primitive).collect();
        let tree = (!points.is_empty()).then(|| Tree::new(&primitives));
        let count = tree.as_ref().map_or(0, |tree| tree.packets.len());
        let packets = vec![Point8::default(); count];
        let mut all = Self { points: points.clone(), tree, packets, frame, simd: Simd::detect() };
        all.fit(normal);
        all
    }

    /// Moves the points and fits the tree to them, as [`PatchBvh`](super::PatchBvh) is fitted. Nothing is
    /// allocated.
    pub(in crate::contact) fn refit(
        &mut self,
        point: impl Fn(VertexId) -> DVec3,
        normal: impl Fn(VertexId) -> DVec3,
    ) {
        for (number, place) in (0..).zip(self.points.iter_mut()) {
            *place = point(VertexId::new(number));
        }
        self.frame = Frame::around(self.points.iter().copied());
        self.fit(normal);
    }

    fn fit(&mut self, normal: impl Fn(VertexId) -> DVec3) {
        let Self { points, tree, packets, frame, simd } = self;
        let Some(tree) = tree else { return };
        let at = |id: u32| frame.point(points[VertexId::from(id)]);
        tree.fit(*simd, |packet, ids, points: &mut Points<1>| {
            packets[packet] = Point8::new(&ids.map(at));
            ids.iter().enumerate().for_each(|(lane, &id)| put(points, lane, [at(id)]));
            ids.iter().map(|&id| normal(VertexId::from(id))).sum()
        });
    }

    /// A tree over the vertices of a mesh.
    pub(in crate::contact) fn of_mesh(mesh: &TriMesh) -> Self {
        let mut normals = IdVec::filled(DVec3::ZERO, mesh.positions.len());
        for (face, corners) in mesh.triangles.enumerate() {
            corners.iter().for_each(|&v| normals[v] += mesh.face_cross(face));
        }
        Self::new(&mesh.positions, |v| normals[v])
    }

    /// The box of its points, in m.
    pub(in crate::contact) fn bounds(&self) -> Aabb {
        self.frame.bounds
    }

    /// Where a point is.
    pub(in crate::contact) fn point(&self, vertex: VertexId) -> DVec3 {
        self.points[vertex]
    }

    /// Appends the `k` points nearest to `q`, none farther than `reach` (m, infinite for no limit),
    /// with their distances in m, the nearest first; of equally near ones the first.
    pub(in crate::contact) fn nearest(
        &self,
        q: DVec3,
        k: usize,
        reach: f64,
        found: &mut Vec<(VertexId, f64)>,
    ) {
        let Some(tree) = self.tree.as_ref().filter(|_| k > 0 && q.is_finite()) else { return };
        let local = self.frame.point(q);
        if k > MOST || local.length() > FAR {
            return self.nearest_in_f64(tree, q, k, reach, found);
        }
        let first = found.len();
        if k <= FEW {
            self.simd.run(Walk::<FEW> { points: self, tree, local, k, reach, found });
        } else {
            self.simd.run(Walk::<MOST> { points: self, tree, local, k, reach, found });
        }
        for (vertex, distance) in &mut found[first..] {
            *distance = self.points[*vertex].distance(q);
        }
        found[first..].sort_unstable_by(nearer);
        let near = found[first..].iter().take(k).take_while(|(_, distance)| *distance <= reach).count();
        found.truncate(first + near);
    }

    fn nearest_in_f64(&self, tree: &Tree, q: DVec3, k: usize, reach: f64, found: &mut Vec<(VertexId, f64)>) {
        let local = self.frame.point(q);
        let first = found.len();
        let mut worst = reach;
        tree.walk(
            reach * self.frame.scale * FAR_ROUND_UP,
            |node| node.point_gaps(local),
            |packet| {
                for vertex in distinct(packet).map(VertexId::from) {
                    let distance = self.points[vertex].distance(q);
                    if distance <= worst {
                        found.push((vertex, distance));
                    }
                    // Not at each point: then many of them would be put in order again and again.
                    if found.len() - first >= k.saturating_mul(2) {
                        worst = found[first..].select_nth_unstable_by(k - 1, nearer).1.1;
                        found.truncate(first + k);
                    }
                }
                worst * self.frame.scale * FAR_ROUND_UP
            },
        );
        found[first..].sort_unstable_by(nearer);
        found.truncate(first.saturating_add(k));
    }

    /// Appends every point in a sphere (m, in the link's frame) with its distance from the centre, in m;
    /// in the order of the points.
    pub(in crate::contact) fn within(&self, centre: DVec3, radius: f64, found: &mut Vec<(VertexId, f64)>) {
        let Some(tree) = &self.tree else { return };
        let before = found.len();
        let local = self.frame.point(centre);
        let bound = radius * self.frame.scale * FAR_ROUND_UP;
        tree.walk(
            bound,
            |node| node.point_gaps(local),
            |packet| {
                for vertex in distinct(packet).map(VertexId::from) {
                    let distance = self.points[vertex].distance(centre);
                    if distance <= radius {
                        found.push((vertex, distance));
                    }
                }
                bound
            },
        );
        found[before..].sort_unstable_by_key(|&(vertex, _)| vertex);
    }
}

/// The order of answers: by distance, equally far ones by their place.
fn nearer(a: &(VertexId, f64), b: &(VertexId, f64)) -> Ordering {
    a.1.total_cmp(&b.1).then(a.0.cmp(&b.0))
}

/// The walk with eight lanes: leaves everything in `found` that may be among the nearest `k`, at most `N`.
struct Walk<'a, const N: usize> {
    points: &'a PointTree,
    tree: &'a Tree,
    local: DVec3,
    k: usize,
    reach: f64,
    found: &'a mut Vec<(VertexId, f64)>,
}

impl<const N: usize> Kernel for Walk<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self { points, tree, local, k, reach, found } = self;
        let slack = slack(local.length(), 1.0);
        let bound = squared_bound_f32(reach * points.frame.scale, slack);
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

struct Nearest<'a, const N: usize> {
    points: &'a PointTree,
    tree: &'a Tree,
    slack: f64,
    /// The least squares, as many as points are looked for, ascending, after lower numbers.
    squares: [f32; N],
    /// Points and their squares.
    found: &'a mut Vec<(VertexId, f64)>,
}

impl<L: Lanes, const N: usize> Visitor<L> for Nearest<'_, N> {
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
            self.found.push((VertexId::from(ids[lane]), f64::from(square)));
            // Without a branch: where it belongs cannot be foreseen.
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
    use crate::contact::soup;

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
            let mut points: IdVec<VertexId, DVec3> = points.into_iter().map(DVec3::from).collect();
            for _ in 0..copies {
                points.push(DVec3::ONE * 0.5);
            }
            let (tree, q) = (PointTree::new(&points, |v| points[v]), DVec3::from(q) * away);
            let mut expected: Vec<_> = points.enumerate().map(|(v, p)| (v, p.distance(q))).collect();
            expected.retain(|&(_, distance)| distance <= reach);
            expected.sort_by(|a, b| (a.1, a.0).partial_cmp(&(b.1, b.0)).unwrap());
            expected.truncate(k);
            let mut found = Vec::new();
            tree.nearest(q, k, reach, &mut found);
            prop_assert_eq!(&found, &expected);

            for radius in [0.0, 0.2, 0.8, 1e9] {
                let all = points.enumerate().map(|(v, p)| (v, p.distance(q)));
                let expected: Vec<_> = all.filter(|&(_, distance)| distance <= radius).collect();
                found.clear();
                tree.within(q, radius, &mut found);
                prop_assert_eq!(&found, &expected);
            }
        }
    }
}
