//! [`TriangleTree`]: the triangle nearest to a point, all near it, and the first that a ray meets.
//!
//! The tree stores its triangles in `f32`, rotated and scaled. The caller, who has the original triangles,
//! measures every candidate in `f64`.

use arrayvec::ArrayVec;
use glam::DVec3;

use crate::descent::{Descent, Visitor, bound_of, entry, parts};
use crate::lanes::{Kernel, LANES, Lanes, Simd};
use crate::packets::{Framing, Triangle8};
use crate::scaling::{FAR, FAR_ROUND_UP, Scaling, slack, squared_bound_f32};
use crate::tree::{MAX_PRIMITIVES, Points, Primitive, Tree, distinct};
use crate::{Aabb, BvhError, Meeting, Ray, meet};

/// Triangles that are collected before they are measured in `f64`.
const PENDING: usize = 16;

/// A tree over triangles; the caller keeps the triangles.
#[derive(Debug, Clone)]
pub struct TriangleTree {
    tree: Tree,
    /// One for each packet of the tree.
    packets: Vec<Triangle8>,
    scaling: Scaling,
    simd: Simd,
}

/// Buffers for [`TriangleTree::refit`], so that it allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct Refitting {
    /// For each packet the corners of its triangles, which are scattered in the mesh.
    corners: Vec<[[u32; LANES]; 3]>,
    /// The vertices in the tree's units, computed once since each belongs to some six triangles. The search's
    /// slack includes their rounding.
    local: Vec<[f32; 4]>,
    /// The vertices of triangles, if a vertex belongs to none.
    used: Option<Vec<u32>>,
}

/// Where a search begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Start {
    /// At the root of the tree.
    Root,
    /// At a packet that may contain the nearest triangle, and from there up the tree.
    Packet(u32),
}

/// The nearest triangle found so far, of one tree or of several, among all or among those that [`Self::takes`] says.
pub trait Nearest: Copy {
    /// Whether [`Self::takes`] leaves triangles out. If not, it is not called.
    const SELECTS: bool = false;
    /// The square of its distance; infinite if there is none.
    fn squared(&self) -> f64;
    /// Whether a triangle counts: the distance of one that does not bounds no search.
    fn takes(&self, triangle: u32) -> bool {
        let _ = triangle;
        true
    }
    /// Measures a triangle that counts and keeps it if it is nearer; returns whether it does.
    fn offer(&mut self, triangle: u32) -> bool;
    /// Loads the data that [`Self::offer`] reads of a triangle into the cache, without waiting for it.
    fn prefetch(&self, triangle: u32);
}

/// Where a ray meets a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RayHit {
    /// Which triangle.
    pub triangle: u32,
    /// From the ray's origin.
    pub distance: f64,
    /// Of the point in the triangle.
    pub barycentric: [f64; 3],
}

impl TriangleTree {
    /// Triangles of one tree, at most.
    pub const MOST: usize = MAX_PRIMITIVES;

    /// Vertices farther from the origin than this are refused: their squares still fit into `f32`.
    pub const LARGEST: f64 = crate::scaling::LARGEST;

    /// A tree over at least one triangle, each given by the indices of its corners.
    ///
    /// # Errors
    /// If there is no triangle, or there are too many, or a vertex is too far away or not a number.
    pub fn new(
        positions: &[DVec3],
        triangles: impl Iterator<Item = [u32; 3]> + Clone,
    ) -> Result<Self, BvhError> {
        // Also true for NaN.
        let far = |p: &DVec3| !(p.is_finite() && p.abs().max_element() <= Self::LARGEST);
        if let Some(vertex) = positions.iter().position(far) {
            return Err(BvhError::TooFar { vertex });
        }
        let corners = |triangle: [u32; 3]| triangle.map(|v| positions[v as usize]);
        let scaling = Scaling::around(triangles.clone().flat_map(corners));
        let primitive = |triangle: [u32; 3]| {
            let [a, b, c] = corners(triangle).map(|p| scaling.point(p));
            Primitive { centre: (a + b + c) / 3.0, area: (b - a).cross(c - a) }
        };
        let primitives: Vec<Primitive> = triangles.clone().map(primitive).collect();
        let count = primitives.len();
        if count == 0 || count > MAX_PRIMITIVES {
            return Err(BvhError::TooMany { count, most: MAX_PRIMITIVES });
        }
        let tree = Tree::new(&primitives);
        let packets = vec![Triangle8::default(); tree.packets.len()];
        let mut fitted = Self { tree, packets, scaling, simd: Simd::detect() };
        let mut refitting = fitted.refitting(positions.len(), triangles);
        fitted.fit(positions, &mut refitting);
        Ok(fitted)
    }

    /// Buffers for [`Self::refit`], for as many vertices and the same triangles.
    pub fn refitting(&self, vertices: usize, triangles: impl Iterator<Item = [u32; 3]>) -> Refitting {
        let triangles: Vec<[u32; 3]> = triangles.collect();
        let corners = |packet: &[u32; LANES]| {
            let of_lanes = packet.map(|triangle| triangles[triangle as usize]);
            [0, 1, 2].map(|k: usize| of_lanes.map(|corners| corners[k]))
        };
        let corners = self.tree.packets.iter().map(corners).collect();
        let mut used: Vec<u32> = triangles.into_iter().flatten().collect();
        used.sort_unstable();
        used.dedup();
        let used = (used.len() < vertices).then_some(used);
        Refitting { corners, local: Vec::with_capacity(vertices), used }
    }

    /// Fits the tree to vertices that have moved, finite ones, none farther than [`Self::LARGEST`]: the
    /// triangles stay in the packets they are in, which is cheaper than a new tree, and as fast to search
    /// as long as neighbours stay neighbours. Nothing is allocated.
    pub fn refit(&mut self, positions: &[DVec3], refitting: &mut Refitting) {
        self.scaling = match &refitting.used {
            Some(used) => Scaling::around(used.iter().map(|&v| positions[v as usize])),
            None => Scaling::around(positions.iter().copied()),
        };
        self.fit(positions, refitting);
    }

    fn fit(&mut self, positions: &[DVec3], Refitting { corners, local, .. }: &mut Refitting) {
        let Self { tree, packets, scaling, simd } = self;
        local.clear();
        local.extend(positions.iter().map(|p| scaling.point(*p).extend(0.0).as_vec4().to_array()));
        tree.fit(*simd, |packet, _, points| {
            simd.run(Setting { corners: &corners[packet], local, points, triangles: &mut packets[packet] })
        });
    }

    /// The box of its triangles.
    pub fn bounds(&self) -> Aabb {
        self.scaling.bounds
    }

    /// Offers the triangle nearest to `q`, and others, to `nearest`, unless it has a nearer one. Returns the
    /// result, and its packet if this search found it and used `f32`.
    #[inline(always)]
    pub fn nearest<N: Nearest>(&self, q: DVec3, start: Start, nearest: N) -> (N, Option<u32>) {
        let local = self.scaling.point(q);
        let away = local.length();
        if away > FAR {
            return (self.nearest_from_far(local, nearest), None);
        }
        self.simd.run(Walk { triangles: self, local, away, nearest, start })
    }

    /// As [`Self::nearest`], from so far away that `f32` cannot distinguish the triangles.
    #[cold]
    fn nearest_from_far<N: Nearest>(&self, local: DVec3, mut nearest: N) -> N {
        let bound = |nearest: &N| nearest.squared().sqrt() * self.scaling.scale * FAR_ROUND_UP;
        self.tree.walk(
            bound(&nearest),
            |node| node.far_gaps(local),
            |packet| {
                for triangle in distinct(packet) {
                    let takes = !N::SELECTS || nearest.takes(triangle);
                    _ = takes && nearest.offer(triangle);
                }
                bound(&nearest)
            },
        );
        nearest
    }

    /// Calls `visit` with every triangle no farther than `radius` from `q`, and some that are slightly
    /// farther, in no order.
    pub fn each_around(&self, q: DVec3, radius: f64, mut visit: impl FnMut(u32)) {
        let (local, reach) = (self.scaling.point(q), radius * self.scaling.scale);
        if local.length() <= FAR {
            return self.simd.run(Around { triangles: self, local, reach, visit: &mut visit });
        }
        let bound = reach * FAR_ROUND_UP;
        self.tree.walk(
            bound,
            |node| node.point_gaps(local),
            |packet| {
                distinct(packet).for_each(&mut visit);
                bound
            },
        );
    }

    /// The first triangle that a ray meets from either side, by its corners; of equally far ones the
    /// first. Rays start at distance zero, a triangle on which one starts is met there, and they leave no gap between
    /// triangles that share a side. A triangle without area is never met.
    pub fn first_hit(&self, ray: &Ray, corners: impl Fn(u32) -> [DVec3; 3]) -> Option<RayHit> {
        let (near, start) = self.scaling.nearby(ray);
        let local = self.scaling.ray(&near);
        let mut best: Option<RayHit> = None;
        self.tree.walk(
            local.longest,
            |node| node.entries(&local),
            |packet| {
                for triangle in distinct(packet) {
                    offer(&mut best, hit(&near, start, triangle, corners(triangle)));
                }
                best.map_or(local.longest, |hit| (hit.distance - start) * self.scaling.scale)
            },
        );
        best
    }

    /// A triangle that a ray meets, as [`Self::first_hit`] finds the first; `hint` is tried before others, as what a ray
    /// nearby met.
    pub fn any_hit(&self, ray: &Ray, hint: Option<u32>, corners: impl Fn(u32) -> [DVec3; 3]) -> Option<u32> {
        let (near, start) = self.scaling.nearby(ray);
        let is_met = |&at: &u32| hit(&near, start, at, corners(at)).is_some();
        let mut met = hint.filter(is_met);
        if met.is_some() {
            return met;
        }
        let local = self.scaling.ray(&near);
        self.tree.walk(
            local.longest,
            |node| node.entries(&local),
            |packet| {
                met = met.or_else(|| distinct(packet).find(is_met));
                if met.is_some() { f64::NEG_INFINITY } else { local.longest }
            },
        );
        met
    }
}

fn hit(ray: &Ray, start: f64, triangle: u32, corners: [DVec3; 3]) -> Option<RayHit> {
    let Meeting { along, barycentric } = meet(ray.origin, ray.direction, corners)?;
    let size =
        corners.into_iter().fold(ray.origin.abs(), |most, corner| most.max(corner.abs())).max_element();
    let is_met = along >= -ROUNDING * size && along <= ray.longest;
    is_met.then_some(RayHit { triangle, distance: start + along.max(0.0), barycentric })
}

/// How far behind the start of a ray a triangle may lie by rounding alone, as a share of the coordinates.
const ROUNDING: f64 = 8.0 * f64::EPSILON;

fn offer(best: &mut Option<RayHit>, hit: Option<RayHit>) {
    let key = |hit: &RayHit| (hit.distance, hit.triangle);
    if let Some(hit) = hit.filter(|hit| best.as_ref().is_none_or(|old| key(hit) < key(old))) {
        *best = Some(hit);
    }
}

/// Sets the corners of the triangles of a packet, and the packet.
struct Setting<'a> {
    corners: &'a [[u32; LANES]; 3],
    local: &'a [[f32; 4]],
    points: &'a mut Points<3>,
    triangles: &'a mut Triangle8,
}

impl Kernel for Setting<'_> {
    type Output = DVec3;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> DVec3 {
        let Self { corners, local, points, triangles } = self;
        for k in 0..3 {
            let mut rows = [&[0.0; 4]; LANES];
            for lane in 0..LANES {
                rows[lane] = &local[corners[k][lane] as usize];
            }
            let [x, y, z] = l.points(rows);
            points[k] = [l.store(x), l.store(y), l.store(z)];
        }
        Framing(points, triangles).run(l)
    }
}

/// The search for the nearest triangle with eight lanes, from where `f32` can distinguish the triangles.
struct Walk<'a, N> {
    triangles: &'a TriangleTree,
    /// The point and its distance from the origin in the tree's frame and units.
    local: DVec3,
    away: f64,
    nearest: N,
    start: Start,
}

impl<N: Nearest> Kernel for Walk<'_, N> {
    type Output = (N, Option<u32>);

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let Self { triangles, local, away, nearest, start } = self;
        let slack = slack(away, 1.0);
        let tree = &triangles.tree;
        let known = nearest.squared().sqrt();
        let bound = squared_bound_f32(known * triangles.scaling.scale, slack);
        let mut descent = Descent::new(l, tree, local.as_vec3().to_array(), bound);
        let mut found = Found { triangles, slack, nearest, packet: None, pending: ArrayVec::new() };
        match start {
            Start::Packet(packet) if (packet as usize) < tree.packets.len() => {
                descent.climb(packet, &mut found);
            }
            Start::Packet(_) | Start::Root => descent.run(&mut found),
        }
        found.measure_pending(descent.bound);
        (found.nearest, found.packet)
    }
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "fewer packets than MAX_PRIMITIVES")]
fn number(packet: usize) -> u32 {
    packet as u32
}

/// The result of a search so far.
struct Found<'a, N> {
    triangles: &'a TriangleTree,
    /// Bound of the rounding error of a distance.
    slack: f64,
    nearest: N,
    /// The packet of the nearest triangle, if this search found it.
    packet: Option<u32>,
    /// Triangles to be measured: squared distance and number; and their packets.
    pending: ArrayVec<(u64, u32), PENDING>,
}

impl<L: Lanes, N: Nearest> Visitor<L> for Found<'_, N> {
    /// Tightens the bound by the nearest triangle of a packet, and collects those that may be nearest of all.
    #[inline(always)]
    fn visit(&mut self, l: L, point: [f32; 3], packet: usize, bound: &mut f32) {
        let ids = &self.triangles.tree.packets[packet];
        let squared = self.triangles.packets[packet].distance_squared(l, point);
        if !N::SELECTS {
            // The last three bits are the lane; setting them all rounds up.
            *bound = bound.min(bound_of(f32::from_bits(l.least(squared) | 7), self.slack));
        }
        let mut mask = l.le(squared, l.splat(*bound));
        if mask == 0 {
            return;
        }
        let squared = l.store(squared);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if N::SELECTS {
                if !self.nearest.takes(ids[lane & 7]) {
                    continue;
                }
                *bound = bound.min(bound_of(squared[lane & 7], self.slack));
            }
            if self.pending.is_full() {
                self.make_room(*bound);
            }
            let triangle = ids[lane & 7];
            self.pending.push((entry(squared[lane & 7], triangle), number(packet)));
            self.nearest.prefetch(triangle);
        }
    }
}

impl<N: Nearest> Found<'_, N> {
    /// Makes room: measures those that may still be nearest.
    #[cold]
    #[inline(never)]
    fn make_room(&mut self, bound: f32) {
        self.measure_pending(bound);
    }

    /// Measures the pending triangles that may still be nearest.
    #[inline(always)]
    fn measure_pending(&mut self, bound: f32) {
        while let Some((noted, packet)) = self.pending.pop() {
            let (squared, triangle) = parts(noted);
            if squared <= bound && self.nearest.offer(triangle) {
                self.packet = Some(packet);
            }
        }
    }
}

/// The search for all triangles within `reach`, with eight lanes.
struct Around<'a, F> {
    triangles: &'a TriangleTree,
    /// The point and the distance in the tree's frame and units.
    local: DVec3,
    reach: f64,
    visit: &'a mut F,
}

impl<F: FnMut(u32)> Kernel for Around<'_, F> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self, l: L) {
        let bound = squared_bound_f32(self.reach, slack(self.local.length(), 1.0));
        Descent::new(l, &self.triangles.tree, self.local.as_vec3().to_array(), bound).run(&mut self);
    }
}

impl<L: Lanes, F: FnMut(u32)> Visitor<L> for Around<'_, F> {
    /// Visits the triangles within the bound; does not change it.
    #[inline(always)]
    fn visit(&mut self, l: L, point: [f32; 3], packet: usize, bound: &mut f32) {
        let ids = &self.triangles.tree.packets[packet];
        let within = l.le(self.triangles.packets[packet].distance_squared(l, point), l.splat(*bound));
        if within != 0 {
            for lane in 0..LANES {
                let is_repeated = lane > 0 && ids[lane] == ids[lane - 1];
                if within >> lane & 1 != 0 && !is_repeated {
                    (self.visit)(ids[lane]);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::soup::{self, distance, sheet};

    /// The nearest triangle to a point, of equally near ones the first.
    #[derive(Clone, Copy)]
    struct Best<'a> {
        q: DVec3,
        triangles: &'a [[DVec3; 3]],
        found: Option<(f64, u32)>,
    }

    impl Nearest for Best<'_> {
        fn squared(&self) -> f64 {
            self.found.map_or(f64::INFINITY, |(distance, _)| distance * distance)
        }

        fn offer(&mut self, triangle: u32) -> bool {
            let new = (distance(self.q, self.triangles[triangle as usize]), triangle);
            let is_nearer = self.found.is_none_or(|old| new < old);
            if is_nearer {
                self.found = Some(new);
            }
            is_nearer
        }

        fn prefetch(&self, _: u32) {}
    }

    fn corners(triangles: &[[DVec3; 3]]) -> impl Iterator<Item = [u32; 3]> + Clone {
        (0_u32..).take(triangles.len()).map(|k| [3 * k, 3 * k + 1, 3 * k + 2])
    }

    fn tree_of(triangles: &[[DVec3; 3]]) -> TriangleTree {
        TriangleTree::new(triangles.as_flattened(), corners(triangles)).unwrap()
    }

    fn assert_finds_the_nearest(tree: &TriangleTree, triangles: &[[DVec3; 3]], q: DVec3) {
        let none = Best { q, triangles, found: None };
        let mut expected = none;
        (0_u32..).take(triangles.len()).for_each(|k| _ = expected.offer(k));
        let (found, _) = tree.nearest(q, Start::Root, none);
        assert_eq!(found.found, expected.found, "from {q}");
        let plain = TriangleTree { simd: Simd::plain(), ..tree.clone() };
        assert_eq!(plain.nearest(q, Start::Root, none).0.found, expected.found, "without AVX2, from {q}");
        // An initial bound changes nothing, even if it is the answer itself.
        assert_eq!(tree.nearest(q, Start::Root, found).0.found, expected.found, "again from {q}");
        // Nor does an initial packet.
        for packet in (0..).take(tree.packets.len() + 1) {
            let (same, near) = tree.nearest(q, Start::Packet(packet), none);
            assert_eq!(same.found, expected.found, "from {q} and packet {packet}");
            let id = expected.found.unwrap().1;
            let holds = |near: u32| tree.tree.packets[near as usize].contains(&id);
            assert!(near.is_none_or(holds), "the packet of the answer");
        }
    }

    #[test]
    fn the_walk_in_f64_begins_where_f32_ends() {
        let bent = |p: glam::DVec2| DVec3::new(p.x, p.y, -0.1 * p.length_squared());
        for triangles in [sheet(8, 8, bent), sheet(8, 8, |p| p.extend(0.0))] {
            let tree = tree_of(&triangles);
            for radii in [0.5, 0.99, 1.01, 2.0, 10.0, 100.0, 1e3, 1e6] {
                for direction in [DVec3::new(0.3, -0.2, 0.5), DVec3::new(0.002, 0.001, 1.0)] {
                    let q = direction.normalize() * (FAR * 6.0 * radii);
                    assert_finds_the_nearest(&tree, &triangles, q);
                }
            }
        }
    }

    /// Thousands of triangles equally near: the first is the answer, and nothing overflows.
    #[test]
    fn of_coincident_triangles_the_first_is_nearest() {
        let triangles = vec![[DVec3::ZERO, DVec3::X, DVec3::Y]; 3000];
        let tree = tree_of(&triangles);
        for q in [DVec3::new(0.2, 0.2, 0.1), DVec3::new(-3.0, 0.1, 0.0), DVec3::splat(1e9)] {
            assert_finds_the_nearest(&tree, &triangles, q);
        }
    }

    #[test]
    fn triangles_that_cannot_be_searched_are_refused() {
        let none = TriangleTree::new(&[], std::iter::empty()).unwrap_err();
        assert_eq!(none, BvhError::TooMany { count: 0, most: TriangleTree::MOST });
        for bad in [DVec3::NAN, DVec3::X * 1e13] {
            let far = TriangleTree::new(&[DVec3::X, bad, DVec3::Y], [[0, 1, 2]].into_iter());
            assert_eq!(far.unwrap_err(), BvhError::TooFar { vertex: 1 });
        }
    }

    proptest! {
        #![proptest_config(soup::fixed(200, 8))]

        #[test]
        fn the_nearest_triangle_is_that_of_brute_force(
            triangles in soup::triangles(1..80),
            directions in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 4),
            away in prop_oneof![Just(1e-6), Just(0.1), Just(2.0), Just(500.0)],
        ) {
            let tree = tree_of(&triangles);
            for direction in directions {
                assert_finds_the_nearest(&tree, &triangles, triangles[0][0] + DVec3::from(direction) * away);
            }
        }

        /// However the triangles move, the answer is that of brute force; moved back, the original answer.
        #[test]
        fn a_refitted_tree_finds_the_nearest(
            before in prop::collection::vec(soup::triangle(), 70),
            after in prop::collection::vec(soup::triangle(), 70),
            size in prop_oneof![Just(1e-3), Just(1.0), Just(1e4)],
            directions in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 4),
        ) {
            let after: Vec<_> = after.iter().map(|t| t.map(|p| p * size + DVec3::Y)).collect();
            let mut tree = tree_of(&before);
            let mut refitting = tree.refitting(3 * before.len(), corners(&before));
            for triangles in [&after, &before] {
                tree.refit(triangles.as_flattened(), &mut refitting);
                for direction in &directions {
                    let q = triangles[0][0] + DVec3::from(*direction) * size;
                    assert_finds_the_nearest(&tree, triangles, q);
                }
            }
        }

        #[test]
        fn triangles_around_a_point_are_those_of_brute_force(
            triangles in soup::triangles(1..80),
            a in prop::array::uniform3(-1.0_f64..1.0),
            radius in prop_oneof![Just(0.0), Just(0.1), Just(0.7), Just(1e9)],
        ) {
            let (tree, a) = (tree_of(&triangles), DVec3::from(a));
            for q in [a, triangles[0][0], a * 1e4, a * 1e11] {
                let is_near = |k: &u32| distance(q, triangles[*k as usize]) <= radius;
                let mut found = Vec::new();
                tree.each_around(q, radius, |k| found.push(k));
                found.sort_unstable();
                let visited = found.len();
                found.dedup();
                prop_assert_eq!(found.len(), visited, "each once");
                found.retain(is_near);
                let expected: Vec<u32> = (0..).take(triangles.len()).filter(is_near).collect();
                prop_assert_eq!(found, expected, "around {}", q);
            }
        }

        #[test]
        fn the_first_hit_is_that_of_brute_force(
            triangles in soup::triangles(1..80),
            from in prop::array::uniform3(-1.5_f64..1.5),
            weights in prop::array::uniform3(0.0_f64..1.0),
            away in prop_oneof![Just(1.0), Just(1e3), Just(1e7)],
            flat in prop::bool::ANY,
            longest in prop_oneof![3 => Just(f64::INFINITY), 1 => Just(1.0)],
        ) {
            let [a, b, c] = triangles[0];
            let target = (a * weights[0] + b * weights[1] + c * weights[2]) / weights.iter().sum::<f64>().max(1e-9);
            let from = DVec3::from(from) * away;
            // Also along an axis, where boxes have no thickness to divide by.
            let direction = if flat { DVec3::X } else { target - from };
            prop_assume!(direction != DVec3::ZERO);
            let (ray, tree) = (Ray::new(from, direction, longest).unwrap(), tree_of(&triangles));
            let (near, start) = tree.scaling.nearby(&ray);
            let mut expected = None;
            for (k, triangle) in (0..).zip(&triangles) {
                offer(&mut expected, hit(&near, start, k, *triangle));
            }
            prop_assert_eq!(tree.first_hit(&ray, |k| triangles[k as usize]), expected);
        }
    }

    #[test]
    fn a_ray_hits_from_any_distance() {
        let triangles = sheet(40, 40, |p| DVec3::new(p.x - 20.0, p.y - 20.0, 0.0) * 0.01);
        let tree = tree_of(&triangles);
        let first_hit = |ray: Option<Ray>| tree.first_hit(&ray.unwrap(), |k| triangles[k as usize]);
        for (away, tolerance) in [(1e-9, 1e-15), (1e-5, 1e-12), (1.0, 1e-12), (1e9, 1e-6)] {
            let origin = DVec3::new(0.001, 0.002, -away);
            let hit = first_hit(Ray::new(origin, DVec3::Z, f64::INFINITY)).unwrap();
            assert!((hit.distance - away).abs() <= tolerance, "{} from {away} m", hit.distance);
            assert_eq!(first_hit(Ray::new(origin, -DVec3::Z, f64::INFINITY)), None);
            assert_eq!(first_hit(Ray::new(origin, DVec3::Z, 0.5 * away)), None);
        }
    }

    /// Rays from inside of a closed surface through its vertices and sides always hit it.
    #[test]
    fn a_closed_surface_has_no_gap() {
        let turn = std::f64::consts::TAU;
        let torus = |p: glam::DVec2| {
            let (s, t) = ((p.x % 24.0) * turn / 24.0, (p.y % 12.0) * turn / 12.0);
            DVec3::new(s.cos() * (1.0 + 0.3 * t.cos()), s.sin() * (1.0 + 0.3 * t.cos()), 0.3 * t.sin())
        };
        let triangles = sheet(24, 12, torus);
        let tree = tree_of(&triangles);
        let inside = DVec3::new(1.01, 0.02, 0.03);
        for [p, _, _] in &triangles {
            for [q, _, _] in triangles.iter().step_by(17) {
                for target in [*p, p.midpoint(*q)] {
                    let ray = Ray::new(inside, target - inside, f64::INFINITY).unwrap();
                    assert!(tree.first_hit(&ray, |k| triangles[k as usize]).is_some(), "misses at {target}");
                }
            }
        }
    }
}
