//! The nearest face of one patch: an ordered, bounded walk down the tree.

use std::hint::black_box;

use glam::DVec3;

use super::{
    lanes::{Kernel, LANES, Lanes},
    node8::{Child, Node8, Target},
    patch_bvh::PatchBvh,
    rounding::{slack, squared_bound_f32},
    tree::{DEPTH, STACK, distinct},
};
use crate::{id::FaceId, mesh::Closest, skin::PatchId};

/// From this many radii away, the slack is as large as the smallest faces: `f64` takes over.
const FAR: f64 = 1000.0;

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
    #[inline(always)]
    pub(crate) fn squared(best: Option<&Self>) -> f64 {
        match best {
            Some(best) => best.closest.squared,
            None => f64::INFINITY,
        }
    }

    /// Keeps the nearer of the two; of equally near ones the first patch's first face.
    #[inline(always)]
    pub(crate) fn offer(best: &mut Option<Self>, patch: PatchId, face: FaceId, closest: Closest) {
        let nearer = match best {
            None => true,
            Some(b) => {
                let (old, new) = (b.closest.squared, closest.squared);
                new < old || (new == old && (patch, face) < (b.patch, b.face))
            }
        };
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
    /// No face farther than this is an answer, in m.
    reach: f64,
}

impl<'a> Search<'a> {
    pub(crate) fn new(patch: &'a PatchBvh, id: PatchId, q: DVec3) -> Self {
        Self { patch, id, q, reach: f64::INFINITY }
    }

    /// Only faces within `reach`, in m.
    pub(in crate::contact) fn within(self, reach: f64) -> Self {
        Self { reach, ..self }
    }

    /// Offers the nearest face of the patch, if it is neither farther than `best` nor out of reach.
    #[inline(always)]
    pub(crate) fn run(self, best: &mut Option<Best>) {
        let local = self.patch.frame.point(self.q);
        let away = local.length();
        if away > FAR {
            return self.run_far(local, best);
        }
        let found = self.patch.simd.run(Walk { search: &self, local, away, best: *best });
        *best = found;
    }

    /// The same from so far away that `f32` cannot distinguish the faces.
    #[cold]
    fn run_far(&self, local: DVec3, best: &mut Option<Best>) {
        let patch = self.patch;
        let bound = |best: &Option<Best>| {
            Best::squared(best.as_ref()).sqrt().min(self.reach) * patch.frame.scale * FAR_ROUND_UP
        };
        patch.tree.walk(
            bound(best),
            |node| node.far_gaps(local),
            |packet| {
                patch.faces(packet).for_each(|face| self.measure(face, best));
                bound(best)
            },
        );
    }

    #[inline(always)]
    fn measure(&self, face: FaceId, best: &mut Option<Best>) {
        let closest = self.patch.measure(self.q, face);
        if self.reach == f64::INFINITY || closest.squared.sqrt() <= self.reach {
            Best::offer(best, self.id, face, closest);
        }
    }
}

/// Bounds in `f64` from far away are enlarged by this: some hundred roundings.
const FAR_ROUND_UP: f64 = 1.0 + 1e-14;

/// The walk with eight lanes, from a distance at which `f32` can distinguish the faces.
struct Walk<'a> {
    search: &'a Search<'a>,
    /// The point and its distance from the origin in the tree's frame and units.
    local: DVec3,
    away: f64,
    best: Option<Best>,
}

impl Kernel for Walk<'_> {
    type Output = Option<Best>;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Option<Best> {
        let Self { search, local, away, best } = self;
        let scale = search.patch.frame.scale;
        let slack = slack(away, 1.0);
        let known = Best::squared(best.as_ref()).sqrt().min(search.reach);
        let mut state = State {
            l,
            search,
            point: local.as_vec3().to_array(),
            slack: 2.0 * slack,
            bound: squared_bound_f32(known * scale, slack),
            best,
            stack: [0; STACK],
            waiting: 0,
            pending: [0; PENDING],
            noted: 0,
        };
        state.descend();
        state.drain();
        state.measure_pending();
        state.best
    }
}

struct State<'a, L: Lanes> {
    l: L,
    search: &'a Search<'a>,
    point: [f32; 3],
    /// What rounding may add to one distance and take from another.
    slack: f64,
    /// Squares above this are of no interest.
    bound: f32,
    best: Option<Best>,
    /// Boxes to be opened: squared distance and child in one number. Distances are not negative, so
    /// their bits sort as they do.
    stack: [u64; STACK],
    waiting: usize,
    /// Triangles to be measured: squared distance and face.
    pending: [u64; PENDING],
    noted: usize,
}

#[inline(always)]
fn entry(squared: f32, number: u32) -> u64 {
    u64::from(squared.to_bits()) << 32 | u64::from(number)
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the halves of 64 bits")]
fn parts(entry: u64) -> (f32, u32) {
    (f32::from_bits((entry >> 32) as u32), entry as u32)
}

impl<L: Lanes> State<'_, L> {
    /// Follows the nearest box down to one packet, whose nearest triangle gives the first bound;
    /// then pushes the other children of the nodes on the way that are within that bound, the
    /// deepest on top.
    ///
    /// Without a bound the walk from the root would push every child of these nodes.
    #[inline(always)]
    fn descend(&mut self) {
        let l = self.l;
        let tree = &self.search.patch.tree;
        let mut trail = [(0_usize, 0_u32, l.splat(0.0)); DEPTH];
        let mut passed = 0;
        let mut at = Child::ROOT;
        while let Target::Node(index) = at.target() {
            let node = &tree.nodes[index];
            let squared = node.distance_squared(l, self.point);
            let lane = l.least(squared) & 7;
            trail[passed] = (index, lane, squared);
            passed += 1;
            at = node.child(lane as usize);
        }
        if let Target::Packet(packet) = at.target() {
            self.visit(packet);
        }
        for &(index, taken, squared) in &trail[..passed] {
            let mask = l.le(squared, l.splat(self.bound)) & !(1 << taken);
            if mask != 0 {
                self.push(&tree.nodes[index], squared, mask);
            }
        }
    }

    /// Opens all boxes within the bound, the nearest of a node first.
    #[inline(always)]
    fn drain(&mut self) {
        let l = self.l;
        let tree = &self.search.patch.tree;
        while self.waiting > 0 {
            self.waiting -= 1;
            let (squared, child) = parts(self.stack[self.waiting]);
            if squared > self.bound {
                continue;
            }
            let mut at = Child(child);
            loop {
                let index = match at.target() {
                    Target::Packet(packet) => {
                        self.visit(packet);
                        break;
                    }
                    Target::Node(index) => index,
                };
                let node = &tree.nodes[index];
                let squared = node.distance_squared(l, self.point);
                let mask = l.le(squared, l.splat(self.bound)) & node.used();
                if mask == 0 {
                    break;
                }
                if mask & (mask - 1) == 0 {
                    // One alone need not go over the stack.
                    at = node.child(mask.trailing_zeros() as usize);
                    continue;
                }
                self.push(node, squared, mask);
                break;
            }
        }
    }

    /// Puts the children of `node` in the lanes of `mask` on top, the nearest uppermost.
    #[inline(always)]
    fn push(&mut self, node: &Node8, squared: L::F, mask: u32) {
        let squared = self.l.store(squared);
        let mut mask = mask & node.used();
        let first = self.waiting;
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let entry = entry(squared[lane & 7], node.child(lane).0);
            let mut slot = self.waiting;
            while slot > first && self.stack[slot - 1] < entry {
                self.stack[slot] = self.stack[slot - 1];
                slot -= 1;
            }
            self.stack[slot] = entry;
            self.waiting += 1;
        }
    }

    /// Tightens the bound by the nearest triangle of a packet, and notes those that may be nearest
    /// of all.
    #[inline(always)]
    fn visit(&mut self, packet: usize) {
        let l = self.l;
        let patch = self.search.patch;
        let faces = &patch.tree.packets[packet];
        let Some(triangles) = patch.triangles.get(packet) else {
            return self.visit_compact(faces);
        };
        let squared = triangles.distance_squared(l, self.point);
        // The last three bits are the lane's: all set, they round up.
        self.tighten(f32::from_bits(l.least(squared) | 7));
        let mut mask = l.le(squared, l.splat(self.bound));
        if mask == 0 {
            return;
        }
        let squared = l.store(squared);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if self.noted == PENDING {
                self.make_room();
            }
            let face = faces[lane & 7];
            self.pending[self.noted] = entry(squared[lane & 7], face);
            self.noted += 1;
            // Loaded into the cache for later, without waiting for it.
            black_box(patch.mesh.triangles[FaceId::from(face)][0]);
        }
    }

    /// A triangle was found at this distance, squared.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "rounded up after")]
    fn tighten(&mut self, squared: f32) {
        let reach = squared.sqrt() + self.slack as f32;
        let bound = reach * reach * (1.0 + 8.0 * f32::EPSILON);
        if bound < self.bound {
            self.bound = bound;
        }
    }

    /// Measures all triangles of a packet on the mesh.
    #[cold]
    #[inline(never)]
    fn visit_compact(&mut self, faces: &[u32; LANES]) {
        for face in distinct(faces) {
            self.search.measure(FaceId::from(face), &mut self.best);
        }
        let frame = &self.search.patch.frame;
        let bound = squared_bound_f32(Best::squared(self.best.as_ref()).sqrt() * frame.scale, self.slack);
        self.bound = self.bound.min(bound);
    }

    /// Room for more: measures those that are still of interest.
    #[cold]
    #[inline(never)]
    fn make_room(&mut self) {
        self.measure_pending();
    }

    /// Measures the noted triangles that may still be nearest.
    #[inline(always)]
    fn measure_pending(&mut self) {
        for k in 0..self.noted {
            let (squared, face) = parts(self.pending[k]);
            if squared <= self.bound {
                self.search.measure(FaceId::from(face), &mut self.best);
            }
        }
        self.noted = 0;
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
