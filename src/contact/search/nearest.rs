//! The nearest face of one patch.

use std::hint::black_box;

use arrayvec::ArrayVec;
use glam::DVec3;

use super::{
    descent::{Descent, Visitor, bound_of, entry, parts},
    lanes::{Kernel, Lanes},
    patch_bvh::PatchBvh,
    rounding::{FAR, FAR_ROUND_UP, slack, squared_bound_f32},
};
use crate::{id::FaceId, mesh::Closest, skin::PatchId};

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

    /// Keeps the nearer of the two; of equally near ones the first patch's first face with area.
    #[inline(always)]
    pub(crate) fn offer(best: &mut Option<Self>, patch: PatchId, face: FaceId, closest: Closest) {
        let nearer = match best {
            None => true,
            Some(b) => {
                let (old, new) = (b.closest.squared, closest.squared);
                let key = |closest: &Closest, patch, face| (closest.is_flat, patch, face);
                new < old || (new == old && key(&closest, patch, face) < key(&b.closest, b.patch, b.face))
            }
        };
        if nearer {
            *best = Some(Self { patch, face, closest });
        }
    }
}

/// Where a walk begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::contact) enum Start {
    Root,
    /// At a packet that may hold the nearest face, and from there up the tree.
    Packet(u32),
}

/// One search for the face of a patch nearest to a point.
pub(crate) struct Search<'a> {
    patch: &'a PatchBvh,
    id: PatchId,
    /// The point, in m in the link's frame.
    q: DVec3,
}

impl<'a> Search<'a> {
    pub(crate) fn new(patch: &'a PatchBvh, id: PatchId, q: DVec3) -> Self {
        Self { patch, id, q }
    }

    /// Offers the nearest face of the patch, if it is not farther than `best`.
    #[inline(always)]
    pub(crate) fn run(self, best: &mut Option<Best>) {
        self.run_from(Start::Root, best);
    }

    /// The same from elsewhere than the root; returns the packet of the nearest face found, if it is
    /// one of this patch.
    #[inline(always)]
    pub(crate) fn run_from(self, start: Start, best: &mut Option<Best>) -> Option<u32> {
        let local = self.patch.frame.point(self.q);
        let away = local.length();
        if away > FAR {
            self.run_far(local, best);
            return None;
        }
        let packet;
        (*best, packet) = self.patch.simd.run(Walk { search: &self, local, away, best: *best, start });
        packet
    }

    /// The same from so far away that `f32` cannot distinguish the faces.
    #[cold]
    fn run_far(&self, local: DVec3, best: &mut Option<Best>) {
        let patch = self.patch;
        let bound =
            |best: &Option<Best>| Best::squared(best.as_ref()).sqrt() * patch.frame.scale * FAR_ROUND_UP;
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
        Best::offer(best, self.id, face, self.patch.measure(self.q, face));
    }
}

/// The walk with eight lanes, from a distance at which `f32` can distinguish the faces.
struct Walk<'a> {
    search: &'a Search<'a>,
    /// The point and its distance from the origin in the tree's frame and units.
    local: DVec3,
    away: f64,
    best: Option<Best>,
    start: Start,
}

impl Kernel for Walk<'_> {
    type Output = (Option<Best>, Option<u32>);

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Self::Output {
        let Self { search, local, away, best, start } = self;
        let slack = slack(away, 1.0);
        let known = Best::squared(best.as_ref()).sqrt();
        let bound = squared_bound_f32(known * search.patch.frame.scale, slack);
        let mut descent = Descent::new(l, &search.patch.tree, local.as_vec3().to_array(), bound);
        let mut found = Found { search, slack, best, packet: None, pending: ArrayVec::new() };
        let tree = &search.patch.tree;
        match start {
            Start::Packet(packet) if (packet as usize) < tree.packets.len() => {
                descent.climb(packet, &mut found);
            }
            Start::Packet(_) | Start::Root => descent.run(&mut found),
        }
        found.measure_pending(descent.bound);
        (found.best, found.packet)
    }
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "fewer packets than MAX_PRIMITIVES")]
fn number(packet: usize) -> u32 {
    packet as u32
}

/// What a walk has found.
struct Found<'a> {
    search: &'a Search<'a>,
    /// What rounding may add to a distance or take from it.
    slack: f64,
    best: Option<Best>,
    /// The packet of `best`, if this walk found it.
    packet: Option<u32>,
    /// Triangles to be measured: squared distance and face; and their packets.
    pending: ArrayVec<(u64, u32), PENDING>,
}

impl<L: Lanes> Visitor<L> for Found<'_> {
    /// Tightens the bound by the nearest triangle of a packet, and notes those that may be nearest
    /// of all.
    #[inline(always)]
    fn visit(&mut self, l: L, point: [f32; 3], packet: usize, bound: &mut f32) {
        let patch = self.search.patch;
        let faces = &patch.tree.packets[packet];
        let squared = patch.triangles[packet].distance_squared(l, point);
        // The last three bits are the lane's: all set, they round up.
        *bound = bound.min(bound_of(f32::from_bits(l.least(squared) | 7), self.slack));
        let mut mask = l.le(squared, l.splat(*bound));
        if mask == 0 {
            return;
        }
        let squared = l.store(squared);
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            if self.pending.is_full() {
                self.make_room(*bound);
            }
            let face = faces[lane & 7];
            self.pending.push((entry(squared[lane & 7], face), number(packet)));
            // Loaded into the cache for later, without waiting for it.
            black_box(patch.mesh.triangles[FaceId::from(face)][0]);
        }
    }
}

impl Found<'_> {
    #[inline(always)]
    fn measure(&mut self, face: FaceId, packet: u32) {
        self.search.measure(face, &mut self.best);
        if self.best.is_some_and(|best| best.face == face && best.patch == self.search.id) {
            self.packet = Some(packet);
        }
    }

    /// Room for more: measures those that are still of interest.
    #[cold]
    #[inline(never)]
    fn make_room(&mut self, bound: f32) {
        self.measure_pending(bound);
    }

    /// Measures the noted triangles that may still be nearest.
    #[inline(always)]
    fn measure_pending(&mut self, bound: f32) {
        while let Some((noted, packet)) = self.pending.pop() {
            let (squared, face) = parts(noted);
            if squared <= bound {
                self.measure(FaceId::from(face), packet);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        contact::{search::lanes::Simd, soup},
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
        let mut plain = patch.clone();
        plain.simd = Simd::plain();
        let mut same = None;
        Search::new(&plain, PatchId::new(0), q).run(&mut same);
        let same = same.unwrap();
        assert_eq!((same.face, same.closest), (found.face, found.closest), "without AVX2, from {q}");
        // A bound to begin with changes nothing, be it the answer itself.
        let mut again = Some(found);
        Search::new(&patch, PatchId::new(0), q).run(&mut again);
        assert_eq!(again.unwrap().face, expected.face, "again from {q}");
        // Nor does a packet to begin with.
        for packet in 0..=patch.tree.packets.len() {
            let (mut same, start) = (None, u32::try_from(packet).unwrap());
            let near = Search::new(&patch, PatchId::new(0), q).run_from(Start::Packet(start), &mut same);
            assert_eq!(same.unwrap().face, expected.face, "from {q} and packet {packet}");
            let holds = |near: u32| patch.tree.packets[near as usize].contains(&expected.face.raw());
            assert!(near.is_none_or(holds), "the packet of the answer");
        }
    }

    #[test]
    fn the_walk_in_f64_begins_where_f32_ends() {
        for mesh in [shapes::cap(500, 0.1, 1.2), shapes::lattice(15, 15, 0.01)] {
            for radii in [0.5, 0.99, 1.01, 2.0, 10.0, 100.0, 1e3, 1e6] {
                for direction in [DVec3::new(0.3, -0.2, 0.5), DVec3::new(0.002, 0.001, 1.0)] {
                    assert_finds_the_nearest(&mesh, direction.normalize() * (FAR * 0.1 * radii));
                }
            }
        }
    }

    /// Thousands of faces equally near: the first is the answer, and nothing overflows.
    #[test]
    fn of_coincident_faces_the_first_is_nearest() {
        let positions: Vec<_> = shapes::triangle().positions.iter().copied().collect();
        let mesh = TriMesh::from_arrays(positions, &vec![[0, 1, 2]; 5000]);
        for q in [DVec3::new(0.2, 0.2, 0.1), DVec3::new(-3.0, 0.1, 0.0), DVec3::splat(1e9)] {
            assert_finds_the_nearest(&mesh, q);
        }
    }

    proptest! {
        #![proptest_config(soup::fixed(200, 8))]

        #[test]
        fn the_nearest_face_is_that_of_brute_force(
            triangles in soup::triangles(1..80),
            directions in prop::collection::vec(prop::array::uniform3(-1.0_f64..1.0), 4),
            away in prop_oneof![Just(1e-6), Just(0.1), Just(2.0), Just(500.0), Just(1e5), Just(1e11)],
        ) {
            let mesh = soup::mesh(&triangles);
            for direction in directions {
                assert_finds_the_nearest(&mesh, triangles[0][0] + DVec3::from(direction) * away);
            }
        }
    }
}
