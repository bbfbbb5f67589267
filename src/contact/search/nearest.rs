//! The nearest face of one patch: an ordered, bounded walk down the tree.

use glam::DVec3;
use wide::f32x8;

use super::{
    bvh8::{Child, Node8, Target},
    lanes::{LANES, Wide3, lanes, least_lane, splat},
    patch_bvh::PatchBvh,
    rounding::{slack, squared_bound_f32},
};
use crate::{id::FaceId, mesh::Closest, skin::PatchId};

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

#[derive(Debug, Clone, Copy)]
pub(crate) struct Best {
    pub(crate) patch: PatchId,
    pub(crate) face: FaceId,
    pub(crate) closest: Closest,
}

impl Best {
    /// Squared distance of the nearest face known, in m^2.
    pub(crate) fn squared(best: Option<&Self>) -> f64 {
        best.map_or(f64::INFINITY, |b| b.closest.squared)
    }

    /// Keeps the nearer of the two; of equally near ones the first patch's first face.
    #[inline]
    pub(crate) fn offer(best: &mut Option<Self>, patch: PatchId, face: FaceId, closest: Closest) {
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
pub(crate) struct Search<'a> {
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
    pub(crate) fn new(patch: &'a PatchBvh, id: PatchId, q: DVec3) -> Self {
        let local = patch.frame.point(q);
        let slack = slack(local.length(), 1.0);
        let wide = splat(local.as_vec3());
        let pending = [(0.0, FaceId::default()); PENDING];
        Self { patch, id, q, local, wide, slack, bound: f32::MAX, pending, pending_len: 0 }
    }

    /// Offers the nearest face of the patch, if it is not farther than `best`: an ordered, bounded,
    /// depth-first walk.
    pub(crate) fn run(mut self, best: &mut Option<Best>) {
        if self.local.length_squared() > FAR * FAR {
            return self.run_far(best);
        }
        let tree = &self.patch.tree;
        let (mut shallow, mut deep) = ([0; SHALLOW], Vec::new());
        if tree.max_stack > SHALLOW {
            deep.resize(tree.max_stack, 0);
        }
        let entries = if deep.is_empty() { &mut shallow[..] } else { &mut deep[..] };
        let mut stack = Stack { entries, len: 0 };
        if best.is_none() && tree.depth <= TRAIL {
            self.descend(&mut stack, best);
        } else {
            self.tighten(best.as_ref());
            stack.push(0.0, Child::ROOT, 0);
        }
        while let Some((squared, child)) = stack.pop() {
            if squared > self.bound {
                continue;
            }
            match child.target() {
                Target::Packet(packet) => self.visit(packet, best),
                Target::Node(index) => {
                    let node = &tree.nodes[index];
                    let squared = node.distance_squared(&self.wide);
                    stack.push_children(node, squared, self.within(squared));
                }
            }
        }
        self.measure_pending(best);
    }

    fn tighten(&mut self, best: Option<&Best>) {
        if let Some(best) = best {
            self.bound = squared_bound_f32(best.closest.squared.sqrt() * self.patch.frame.scale, self.slack);
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
    fn descend(&mut self, stack: &mut Stack<'_>, best: &mut Option<Best>) {
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
                    at = node.children[lane];
                }
            }
        };
        self.visit(packet, best);
        for &(index, taken, squared) in &trail[..passed] {
            let mask = self.within(squared) & !(1 << taken);
            stack.push_children(&tree.nodes[index], squared, mask);
        }
    }

    /// One bit for each lane that may hold the nearest face.
    #[inline]
    fn within(&self, squared: f32x8) -> u32 {
        squared.simd_le(f32x8::splat(self.bound)).to_bitmask()
    }

    /// The same from so far away that `f32` cannot distinguish the faces: boxes in `f64`, nearest
    /// first.
    fn run_far(&self, best: &mut Option<Best>) {
        let tree = &self.patch.tree;
        let mut stack = vec![(0.0, Child::ROOT)];
        while let Some((squared, at)) = stack.pop() {
            let reach = Best::squared(best.as_ref()) * self.patch.frame.scale * self.patch.frame.scale;
            if squared > reach * FAR_ROUND_UP {
                continue;
            }
            match at.target() {
                Target::Packet(packet) => {
                    let packet = &tree.packets[packet];
                    for lane in lanes(packet.used) {
                        let face = packet.faces[lane];
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
                            stack.push((squared, node.children[lane]));
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
        let mask = self.within(squared) & packet.used;
        let squared = squared.as_array();
        let nearest = lanes(mask).reduce(|a, b| if squared[b] < squared[a] { b } else { a });
        let Some(nearest) = nearest else { return };
        self.measure(packet.faces[nearest], best);
        for lane in lanes(mask & !(1 << nearest)) {
            if squared[lane] <= self.bound {
                if self.pending_len == PENDING {
                    self.measure_pending(best);
                }
                self.pending[self.pending_len] = (squared[lane], packet.faces[lane]);
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

/// Children to be visited and the squared distances of their boxes.
struct Stack<'a> {
    /// Squared distance and child in one number: distances are not negative, so their bits sort as
    /// they do.
    entries: &'a mut [u64],
    len: usize,
}

impl Stack<'_> {
    /// Puts a child above entry `first`, below those that are nearer.
    #[inline]
    fn push(&mut self, squared: f32, child: Child, first: usize) {
        let entry = u64::from(squared.to_bits()) << 32 | u64::from(child.0);
        let mut slot = self.len;
        while slot > first && self.entries[slot - 1] < entry {
            self.entries[slot] = self.entries[slot - 1];
            slot -= 1;
        }
        self.entries[slot] = entry;
        self.len += 1;
    }

    /// Puts the children of `node` in the lanes of `mask` on top, the nearest uppermost.
    #[inline]
    fn push_children(&mut self, node: &Node8, squared: f32x8, mask: u32) {
        let (squared, first) = (squared.as_array(), self.len);
        for lane in lanes(mask) {
            self.push(squared[lane], node.children[lane], first);
        }
    }

    #[inline]
    #[expect(clippy::cast_possible_truncation, reason = "the halves of 64 bits")]
    fn pop(&mut self) -> Option<(f32, Child)> {
        self.len = self.len.checked_sub(1)?;
        let entry = self.entries[self.len];
        Some((f32::from_bits((entry >> 32) as u32), Child(entry as u32)))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        contact::soup,
        mesh::{TriMesh, closest_point, shapes},
    };

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

    #[test]
    fn the_walk_in_f64_begins_where_f32_ends() {
        let mesh = shapes::cap(500, 0.1, 1.2);
        for radii in [0.5, 0.99, 1.01, 2.0, 1e3, 1e6] {
            assert_finds_the_nearest(&mesh, DVec3::new(0.3, -0.2, 0.5).normalize() * (FAR * 0.1 * radii));
        }
    }

    proptest! {
        #![proptest_config(soup::fixed(200, 8))]

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
