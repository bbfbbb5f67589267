//! The nearest face of one patch: an ordered, bounded walk down the tree.

use glam::DVec3;
use wide::f32x8;

use super::{
    bvh8::{Child, Node8},
    lanes::{LANES, Wide3, lanes, least_lane, splat},
    patch_bvh::PatchBvh,
    rounding::{slack, squared_bound_f32},
};
use crate::{contact::geometry::Closest, id::FaceId, skin::PatchId};

/// From this many radii away, the slack is as large as the smallest faces: `f64` boxes take over.
const FAR: f64 = 1000.0;

/// Squares found in `f64` are compared with bounds enlarged by this: some hundred roundings.
const FAR_ROUND_UP: f64 = 1.0 + 1e-14;

/// Entries of a walk that are kept without an allocation: trees of some ten million triangles.
const SHALLOW: usize = 80;

/// Nodes on the way down that are remembered; deeper trees, of coincident triangles, are walked from the root.
const TRAIL: usize = 12;

/// Triangles that wait to be measured; more are measured at once.
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
    waiting: usize,
}

impl<'a> Search<'a> {
    pub(in crate::contact) fn new(patch: &'a PatchBvh, id: PatchId, q: DVec3) -> Self {
        let local = (q - patch.origin) * patch.scale;
        let slack = slack(local.length(), 1.0);
        let wide = splat(local.as_vec3());
        let pending = [(0.0, FaceId::default()); PENDING];
        Self { patch, id, q, local, wide, slack, bound: f32::MAX, pending, waiting: 0 }
    }

    /// Offers the nearest face of the patch, if it is not farther than `best`.
    pub(in crate::contact) fn run(mut self, best: &mut Option<Best>) {
        if self.local.length_squared() > FAR * FAR {
            return self.run_far(best);
        }
        let tree = &self.patch.tree;
        let mut shallow = [0; SHALLOW];
        let mut deep;
        let stack: &mut [u64] = if tree.waiting <= SHALLOW {
            &mut shallow
        } else {
            deep = vec![0; tree.waiting];
            &mut deep
        };
        let mut waiting = 0;
        if best.is_none() && tree.depth <= TRAIL {
            self.descend(stack, &mut waiting, best);
        } else {
            self.tighten(best.as_ref());
            stack[0] = u64::from(Child::ROOT.0);
            waiting = 1;
        }
        self.walk(stack, waiting, best);
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

    /// Follows the nearest box down to one packet, whose nearest triangle gives a bound to begin with; then what the
    /// way passed by waits on the stack as far as it is within that bound, the last passed on top.
    fn descend(&mut self, stack: &mut [u64], waiting: &mut usize, best: &mut Option<Best>) {
        let tree = &self.patch.tree;
        let mut trail = [(0, 0, f32x8::ZERO); TRAIL];
        let mut passed = 0;
        let mut at = Child::ROOT;
        let packet = loop {
            match at.open() {
                Ok(packet) => break packet,
                Err(index) => {
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
            push(&tree.nodes[index], squared, mask, stack, waiting);
        }
    }

    /// One bit for each lane that may hold the nearest face.
    #[inline]
    fn within(&self, squared: f32x8) -> u32 {
        squared.simd_le(f32x8::splat(self.bound)).to_bitmask()
    }

    /// Ordered, bounded, depth-first: everything that waits on the stack and all below it.
    fn walk(&mut self, stack: &mut [u64], mut waiting: usize, best: &mut Option<Best>) {
        let tree = &self.patch.tree;
        while waiting > 0 {
            waiting -= 1;
            let (squared, child) = unpack(stack[waiting]);
            if squared > self.bound {
                continue;
            }
            match child.open() {
                Ok(packet) => self.visit(packet, best),
                Err(index) => {
                    let node = &tree.nodes[index];
                    let squared = node.distance_squared(&self.wide);
                    push(node, squared, self.within(squared), stack, &mut waiting);
                }
            }
        }
    }

    /// The same from so far away that `f32` cannot tell the faces apart: boxes in `f64`, nearest first.
    fn run_far(&self, best: &mut Option<Best>) {
        let tree = &self.patch.tree;
        let mut stack = vec![(0.0, Child::ROOT)];
        while let Some((squared, at)) = stack.pop() {
            let reach = Best::squared(best.as_ref()) * self.patch.scale * self.patch.scale;
            if squared > reach * FAR_ROUND_UP {
                continue;
            }
            match at.open() {
                Ok(packet) => {
                    let packet = &tree.packets[packet];
                    for lane in lanes(packet.used()) {
                        let face = packet.face(lane);
                        Best::offer(best, self.id, face, self.patch.measure(self.q, face));
                    }
                }
                Err(node) => {
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

    /// Measures the nearest triangle of a packet and keeps in mind those others that may be as near.
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
                if self.waiting == PENDING {
                    self.measure_pending(best);
                }
                self.pending[self.waiting] = (squared[lane], packet.face(lane));
                self.waiting += 1;
            }
        }
    }

    /// Measures the triangles kept in mind that may still be as near as the best.
    fn measure_pending(&mut self, best: &mut Option<Best>) {
        for k in 0..self.waiting {
            let (squared, face) = self.pending[k];
            if squared <= self.bound {
                self.measure(face, best);
            }
        }
        self.waiting = 0;
    }
}

/// Puts the children of `node` in the lanes of `mask` onto the stack, the nearest on top.
#[inline]
fn push(node: &Node8, squared: f32x8, mask: u32, stack: &mut [u64], waiting: &mut usize) {
    let squared = squared.as_array();
    let first = *waiting;
    for lane in lanes(mask) {
        // Distances are not negative, so their bits sort as they do.
        let entry = u64::from(squared[lane].to_bits()) << 32 | u64::from(node.child(lane).0);
        let mut slot = *waiting;
        while slot > first && stack[slot - 1] < entry {
            stack[slot] = stack[slot - 1];
            slot -= 1;
        }
        stack[slot] = entry;
        *waiting += 1;
    }
}

/// Squared distance and child of a walk's entry.
#[inline]
#[expect(clippy::cast_possible_truncation, reason = "the halves of 64 bits")]
fn unpack(entry: u64) -> (f32, Child) {
    (f32::from_bits((entry >> 32) as u32), Child(entry as u32))
}
