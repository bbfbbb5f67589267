//! The nearest face of one patch: an ordered, bounded walk down the tree.

use glam::DVec3;
use wide::f32x8;

use super::{
    bvh8::{Child, Node8, Target},
    lanes::{LANES, Wide3, lanes, least_lane, splat},
    patch_bvh::PatchBvh,
    rounding::{slack, squared_bound_f32},
};
use crate::{contact::geometry::Closest, id::FaceId, skin::PatchId};

/// From this many radii away, the slack is as large as the smallest faces: `f64` boxes take over.
const FAR: f64 = 1000.0;

/// Squares found in `f64` are compared with bounds enlarged by this: some hundred roundings.
const FAR_ROUND_UP: f64 = 1.0 + 1e-14;

/// Entries of the stack that need no allocation: enough for trees of some ten million triangles.
const SHALLOW: usize = 80;

/// Most nodes on the first way down; deeper trees, of coincident triangles, are walked from the
/// root.
const TRAIL: usize = 12;

/// Triangles that are collected before they are measured in `f64`.
const PENDING: usize = 16;

/// The nearest face known so far.
#[derive(Debug, Clone, Copy)]
pub(in crate::contact) struct Best {
    pub(in crate::contact) patch: PatchId,
    pub(in crate::contact) face: FaceId,
    pub(in crate::contact) closest: Closest,
}

impl Best {
    /// Squared distance of the nearest face known, in m^2.
    pub(in crate::contact) fn squared(best: Option<&Self>) -> f64 {
        best.map_or(f64::INFINITY, |b| b.closest.squared)
    }

    /// Keeps the nearer of the two; of equally near ones the first patch's first face.
    #[inline]
    pub(in crate::contact) fn offer(best: &mut Option<Self>, patch: PatchId, face: FaceId, closest: Closest) {
        let nearer = best.as_ref().is_none_or(|b| {
            let (old, new) = (b.closest.squared, closest.squared);
            new < old || (new == old && (patch, face) < (b.patch, b.face))
        });
        if nearer {
            *best = Some(Self { patch, face, closest });
        }
    }
}

/// One search for the face of a patch nearest to a point.
pub(in crate::contact) struct Search<'a> {
    patch: &'a PatchBvh,
    id: PatchId,
    /// The point, in m in the link's frame.
    q: DVec3,
    /// The same in the tree's frame and units.
    local: DVec3,
    wide: Wide3,
    slack: f64,
    /// What a face must not exceed to be of interest: [`squared_bound_f32`] of the best.
    bound: f32,
    pending: [(f32, FaceId); PENDING],
    pending_len: usize,
}

impl<'a> Search<'a> {
    pub(in crate::contact) fn new(patch: &'a PatchBvh, id: PatchId, q: DVec3) -> Self {
        let local = (q - patch.origin) * patch.scale;
        let slack = slack(local.length(), 1.0);
        let wide = splat(local.as_vec3());
        let pending = [(0.0, FaceId::default()); PENDING];
        Self { patch, id, q, local, wide, slack, bound: f32::MAX, pending, pending_len: 0 }
    }

    /// Offers the nearest face of the patch, if it is not farther than `best`.
    pub(in crate::contact) fn run(mut self, best: &mut Option<Best>) {
        if self.local.length_squared() > FAR * FAR {
            return self.run_far(best);
        }
        let tree = &self.patch.tree;
        let mut shallow = [0; SHALLOW];
        let mut deep;
        let stack: &mut [u64] = if tree.max_stack <= SHALLOW {
            &mut shallow
        } else {
            deep = vec![0; tree.max_stack];
            &mut deep
        };
        let mut stack_len = 0;
        if best.is_none() && tree.depth <= TRAIL {
            self.descend(stack, &mut stack_len, best);
        } else {
            self.tighten(best.as_ref());
            stack[0] = u64::from(Child::ROOT.0);
            stack_len = 1;
        }
        self.walk(stack, stack_len, best);
        self.measure_pending(best);
    }

    fn tighten(&mut self, best: Option<&Best>) {
        if let Some(best) = best {
            self.bound = squared_bound_f32(best.closest.squared.sqrt() * self.patch.scale, self.slack);
        }
    }

    fn measure(&mut self, face: FaceId, best: &mut Option<Best>) {
        let before = Best::squared(best.as_ref());
        let closest = self.patch.measure(self.q, face);
        Best::offer(best, self.id, face, closest);
        if closest.squared < before {
            self.tighten(best.as_ref());
        }
    }

    /// Follows the nearest box down to one packet, whose nearest triangle gives the first bound;
    /// then pushes the other children of the nodes on the way that are within that bound, the
    /// deepest on top.
    ///
    /// Without a bound the walk from the root would push every child of these nodes.
    fn descend(&mut self, stack: &mut [u64], stack_len: &mut usize, best: &mut Option<Best>) {
        let tree = &self.patch.tree;
        let mut trail = [(0, 0, f32x8::ZERO); TRAIL];
        let mut passed = 0;
        let mut at = Child::ROOT;
        let packet = loop {
            match at.target() {
                Target::Packet(packet) => break packet,
                Target::Node(index) => {
                    let node = &tree.nodes[index];
                    let squared = node.distance_squared(&self.wide);
                    let lane = least_lane(squared);
                    trail[passed] = (index, lane, squared);
                    passed += 1;
                    at = node.child(lane);
                }
            }
        };
        self.visit(packet, best);
        for &(index, taken, squared) in &trail[..passed] {
            let mask = self.within(squared) & !(1 << taken);
            push(&tree.nodes[index], squared, mask, stack, stack_len);
        }
    }

    /// One bit for each lane that may hold the nearest face.
    #[inline]
    fn within(&self, squared: f32x8) -> u32 {
        squared.simd_le(f32x8::splat(self.bound)).to_bitmask()
    }

    /// The ordered, bounded, depth-first walk through everything on the stack and below it.
    fn walk(&mut self, stack: &mut [u64], mut stack_len: usize, best: &mut Option<Best>) {
        let tree = &self.patch.tree;
        while stack_len > 0 {
            stack_len -= 1;
            let (squared, child) = unpack(stack[stack_len]);
            if squared > self.bound {
                continue;
            }
            match child.target() {
                Target::Packet(packet) => self.visit(packet, best),
                Target::Node(index) => {
                    let node = &tree.nodes[index];
                    let squared = node.distance_squared(&self.wide);
                    push(node, squared, self.within(squared), stack, &mut stack_len);
                }
            }
        }
    }

    /// The same from so far away that `f32` cannot distinguish the faces: boxes in `f64`, nearest
    /// first.
    fn run_far(&self, best: &mut Option<Best>) {
        let tree = &self.patch.tree;
        let mut stack = vec![(0.0, Child::ROOT)];
        while let Some((squared, at)) = stack.pop() {
            let reach = Best::squared(best.as_ref()) * self.patch.scale * self.patch.scale;
            if squared > reach * FAR_ROUND_UP {
                continue;
            }
            match at.target() {
                Target::Packet(packet) => {
                    let packet = &tree.packets[packet];
                    for lane in lanes(packet.used()) {
                        let face = packet.face(lane);
                        Best::offer(best, self.id, face, self.patch.measure(self.q, face));
                    }
                }
                Target::Node(node) => {
                    let node = &tree.nodes[node];
                    let first = stack.len();
                    for lane in 0..LANES {
                        let (lo, hi) = node.bounds(lane);
                        let squared = self.local.distance_squared(self.local.clamp(lo, hi));
                        if squared.is_finite() {
                            stack.push((squared, node.child(lane)));
                        }
                    }
                    stack[first..].sort_by(|a, b| b.0.total_cmp(&a.0));
                }
            }
        }
    }

    /// Measures the nearest triangle of a packet, and collects the others that may be as near.
    fn visit(&mut self, packet: usize, best: &mut Option<Best>) {
        let packet = &self.patch.tree.packets[packet];
        let squared = packet.distance_squared(&self.wide);
        let mask = self.within(squared) & packet.used();
        let squared = squared.as_array();
        let nearest = lanes(mask).reduce(|a, b| if squared[b] < squared[a] { b } else { a });
        let Some(nearest) = nearest else { return };
        self.measure(packet.face(nearest), best);
        for lane in lanes(mask & !(1 << nearest)) {
            if squared[lane] <= self.bound {
                if self.pending_len == PENDING {
                    self.measure_pending(best);
                }
                self.pending[self.pending_len] = (squared[lane], packet.face(lane));
                self.pending_len += 1;
            }
        }
    }

    /// Measures the collected triangles that may still be as near as the best.
    fn measure_pending(&mut self, best: &mut Option<Best>) {
        for k in 0..self.pending_len {
            let (squared, face) = self.pending[k];
            if squared <= self.bound {
                self.measure(face, best);
            }
        }
        self.pending_len = 0;
    }
}

/// Puts the children of `node` in the lanes of `mask` onto the stack, the nearest on top.
#[inline]
fn push(node: &Node8, squared: f32x8, mask: u32, stack: &mut [u64], stack_len: &mut usize) {
    let squared = squared.as_array();
    let first = *stack_len;
    for lane in lanes(mask) {
        // Distances are not negative, so their bits sort as they do.
        let entry = u64::from(squared[lane].to_bits()) << 32 | u64::from(node.child(lane).0);
        let mut slot = *stack_len;
        while slot > first && stack[slot - 1] < entry {
            stack[slot] = stack[slot - 1];
            slot -= 1;
        }
        stack[slot] = entry;
        *stack_len += 1;
    }
}

/// Squared distance and child of a walk's entry.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "the halves of 64 bits")]
fn unpack(entry: u64) -> (f32, Child) {
    (f32::from_bits((entry >> 32) as u32), Child(entry as u32))
}

#[cfg(test)]
mod tests {
    use proptest::{prelude::*, test_runner::RngSeed};

    use super::*;
    use crate::{
        contact::{geometry::closest_point, search::soup},
        mesh::{TriMesh, shapes},
    };

    /// The nearest face, measured one by one.
    fn brute(mesh: &TriMesh, q: DVec3) -> Best {
        let mut best = None;
        for face in mesh.triangles.ids() {
            let closest = closest_point(q, mesh.corners(face), mesh.triangles[face]);
            Best::offer(&mut best, PatchId::new(0), face, closest);
        }
        best.unwrap()
    }

    fn assert_finds_the_nearest(mesh: &TriMesh, q: DVec3) {
        let patch = PatchBvh::new("patch", mesh).unwrap();
        let expected = brute(mesh, q);
        let mut found = None;
        Search::new(&patch, PatchId::new(0), q).run(&mut found);
        let found = found.unwrap();
        assert_eq!((found.face, found.closest), (expected.face, expected.closest), "from {q}");
        // A bound to begin with changes nothing, be it the answer itself.
        let mut again = Some(found);
        Search::new(&patch, PatchId::new(0), q).run(&mut again);
        assert_eq!(again.unwrap().face, expected.face, "again from {q}");
    }

    /// Deeper than the trail, with more triangles at one place than wait to be measured.
    #[test]
    fn of_coincident_triangles_the_first_is_nearest() {
        let triangle = shapes::triangle();
        for n in [1, 8, 9, 64, 5000] {
            let mesh =
                TriMesh::from_arrays(triangle.positions.iter().copied().collect(), &vec![[0, 1, 2]; n]);
            assert_finds_the_nearest(&mesh, DVec3::new(0.2, 0.2, 0.5));
        }
    }

    #[test]
    fn the_walk_in_f64_begins_where_f32_ends() {
        let mesh = shapes::cap(500, 0.1, 1.2);
        for radii in [0.5, 0.99, 1.01, 2.0, 1e3, 1e6] {
            assert_finds_the_nearest(&mesh, DVec3::new(0.3, -0.2, 0.5).normalize() * (FAR * 0.1 * radii));
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 200,
            rng_seed: RngSeed::Fixed(8),
            failure_persistence: None,
            ..ProptestConfig::default()
        })]

        #[test]
        fn the_nearest_face_is_that_of_brute_force(
            triangles in prop::collection::vec(soup::triangle(), 1..80),
            directions in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 4),
            away in prop_oneof![Just(1e-6), Just(0.1), Just(2.0), Just(500.0), Just(1e5)],
        ) {
            let mesh = soup::mesh(&triangles);
            for direction in directions {
                assert_finds_the_nearest(&mesh, triangles[0][0] + DVec3::from(direction) * away);
            }
        }
    }
}
