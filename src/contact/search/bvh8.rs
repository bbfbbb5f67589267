//! A bounding volume hierarchy with eight boxes to a node, over packets of eight triangles.

use std::time::Duration;

use glam::{DVec3, Vec3A};
use obvhs::{Boundable, BvhBuildParams, aabb::Aabb, bvh2::Bvh2, bvh2::builder::build_bvh2};
use wide::f32x8;

use super::{
    lanes::{LANES, Wide3, lanes},
    triangle8::Triangle8,
};
use crate::id::{FaceId, IdVec};

/// Where a [`Child`] leads: to a node or to a packet of triangles.
pub(super) enum Target {
    Node(usize),
    Packet(usize),
}

/// What a slot of a node holds: nothing, a node, or (top bit) a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Child(pub(super) u32);

/// Children that are packets have this bit.
const PACKET: u32 = 1 << 31;

/// Faces of one tree, at most: numbers of nodes and packets must stay clear of [`PACKET`].
pub(super) const MAX_FACES: usize = 1 << 28;

impl Child {
    const NONE: Self = Self(u32::MAX);
    pub(super) const ROOT: Self = Self(0);

    #[expect(clippy::cast_possible_truncation, reason = "there are fewer nodes than MAX_FACES")]
    fn node(index: usize) -> Self {
        Self(index as u32)
    }

    #[expect(clippy::cast_possible_truncation, reason = "there are fewer packets than MAX_FACES")]
    fn packet(index: usize) -> Self {
        Self(PACKET | index as u32)
    }

    #[inline]
    pub(super) fn target(self) -> Target {
        if self.0 & PACKET == 0 {
            Target::Node(self.0 as usize)
        } else {
            Target::Packet((self.0 & !PACKET) as usize)
        }
    }
}

/// Eight boxes side by side. Empty slots are boxes at infinity.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node8 {
    lo: Wide3,
    hi: Wide3,
    pub(super) children: [Child; LANES],
}

/// Largest `f32` that is not above `x`: box minima round down, so a box only grows.
#[expect(clippy::cast_possible_truncation, reason = "the tree stores f32 boxes")]
fn round_down(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) > x { y.next_down() } else { y }
}

/// The smallest `f32` box around `points`.
pub(super) fn enclose(points: impl IntoIterator<Item = DVec3>) -> Aabb {
    let mut lo = DVec3::INFINITY;
    let mut hi = DVec3::NEG_INFINITY;
    for p in points {
        (lo, hi) = (lo.min(p), hi.max(p));
    }
    let down = |v: DVec3| Vec3A::from(v.to_array().map(round_down));
    Aabb::new(down(lo), -down(-hi))
}

impl Node8 {
    /// At most eight boxes with what is in them.
    fn new(children: impl IntoIterator<Item = (Aabb, Child)>) -> Self {
        let mut lo = [[f32::INFINITY; LANES]; 3];
        let mut hi = lo;
        let mut slots = [Child::NONE; LANES];
        for (lane, (bounds, child)) in children.into_iter().take(LANES).enumerate() {
            for axis in 0..3 {
                lo[axis][lane] = bounds.min[axis];
                hi[axis][lane] = bounds.max[axis];
            }
            slots[lane] = child;
        }
        Self { lo: lo.map(f32x8::new), hi: hi.map(f32x8::new), children: slots }
    }

    /// Nodes that hold all of `bounds`, eight by eight; the child in a slot is the number of its
    /// box.
    pub(super) fn rows(bounds: &[Aabb]) -> Vec<Self> {
        let numbered: Vec<_> = bounds.iter().enumerate().map(|(i, b)| (*b, Child::node(i))).collect();
        numbered.chunks(LANES).map(|row| Self::new(row.iter().copied())).collect()
    }

    /// The box around all slots.
    fn enclosed(&self) -> Aabb {
        let corner = |rows: &[[f32; LANES]; 3], pick: fn(f32, f32) -> f32| {
            let of = |row: &[f32; LANES]| row.iter().copied().reduce(pick).unwrap_or(0.0);
            Vec3A::new(of(&rows[0]), of(&rows[1]), of(&rows[2]))
        };
        // Empty slots are at plus infinity in both.
        let hi = self.hi.map(|row| row.to_array().map(|x| if x.is_finite() { x } else { f32::NEG_INFINITY }));
        Aabb::new(corner(&self.lo.map(f32x8::to_array), f32::min), corner(&hi, f32::max))
    }

    /// The box of a slot, `(min, max)`; at infinity for an empty slot.
    pub(super) fn bounds(&self, lane: usize) -> (DVec3, DVec3) {
        let pick = |v: &Wide3| DVec3::from(std::array::from_fn(|k| f64::from(v[k].as_array()[lane])));
        (pick(&self.lo), pick(&self.hi))
    }

    /// Squared distances of `q` to the boxes; infinite for empty slots.
    #[inline]
    pub(super) fn distance_squared(&self, q: &Wide3) -> f32x8 {
        let axis = |k: usize| {
            let d = (self.lo[k] - q[k]).fast_max(q[k] - self.hi[k]).fast_max(f32x8::ZERO);
            d * d
        };
        axis(0) + axis(1) + axis(2)
    }
}

/// A tree of boxes, eight to a node, over packets of up to eight triangles.
#[derive(Debug, Clone)]
pub(super) struct Bvh8 {
    pub(super) nodes: Vec<Node8>,
    pub(super) packets: Vec<Triangle8>,
    /// Most entries on the stack of an ordered walk. Coincident triangles make deep trees, so this
    /// is counted, not guessed.
    pub(super) max_stack: usize,
    /// Nodes on the longest way from the root to a packet.
    pub(super) depth: usize,
}

struct Boxed(Aabb);

impl Boundable for Boxed {
    fn aabb(&self) -> Aabb {
        self.0
    }
}

impl Bvh8 {
    /// A tree over at least one and at most [`MAX_FACES`] triangles, whose corners are finite and
    /// about 1.
    pub(super) fn new(triangles: &IdVec<FaceId, [DVec3; 3]>) -> Self {
        let bounds: Vec<Boxed> = triangles.iter().map(|corners| Boxed(enclose(*corners))).collect();
        // One triangle a leaf: how many go into a packet is decided when the tree is collapsed.
        let params = BvhBuildParams { max_prims_per_leaf: 1, ..BvhBuildParams::medium_build() };
        let binary = build_bvh2(&bounds, params, &mut Duration::default());
        Collapse { counts: count_triangles(&binary), binary, triangles }.run()
    }
}

impl Bvh8 {
    /// Fits all boxes and packets to triangles that have moved.
    pub(super) fn refit(&mut self, corners: impl Fn(FaceId) -> [DVec3; 3]) {
        // Nodes come before the nodes below them.
        for index in (0..self.nodes.len()).rev() {
            let mut children = Vec::with_capacity(LANES);
            for child in self.nodes[index].children {
                if child == Child::NONE {
                    continue;
                }
                let bounds = match child.target() {
                    Target::Node(below) => self.nodes[below].enclosed(),
                    Target::Packet(packet) => {
                        let packet = &mut self.packets[packet];
                        let faces = lanes(packet.used).map(|lane| packet.faces[lane]);
                        let triangles: Vec<_> = faces.map(|face| (face, corners(face))).collect();
                        *packet = Triangle8::new(&triangles);
                        enclose(triangles.iter().flat_map(|(_, corners)| *corners))
                    }
                };
                children.push((bounds, child));
            }
            self.nodes[index] = Node8::new(children);
        }
    }
}

/// Number of triangles below each node, without recursion.
fn count_triangles(binary: &Bvh2) -> Vec<u32> {
    let mut counts = vec![0; binary.nodes.len()];
    let mut order = Vec::with_capacity(binary.nodes.len());
    let mut stack = vec![0];
    while let Some(at) = stack.pop() {
        order.push(at);
        if !binary.nodes[at].is_leaf() {
            let first = binary.nodes[at].first_index as usize;
            stack.extend([first, first + 1]);
        }
    }
    for &at in order.iter().rev() {
        let node = &binary.nodes[at];
        let first = node.first_index as usize;
        counts[at] = if node.is_leaf() { node.prim_count } else { counts[first] + counts[first + 1] };
    }
    counts
}

struct Collapse<'a> {
    binary: Bvh2,
    counts: Vec<u32>,
    triangles: &'a IdVec<FaceId, [DVec3; 3]>,
}

impl Collapse<'_> {
    fn run(&self) -> Bvh8 {
        let mut tree = Bvh8 { nodes: Vec::new(), packets: Vec::new(), max_stack: 0, depth: 0 };
        // Binary node, the wide slot it goes into, the entries on the stack of a walk that comes
        // there, and the depth.
        let mut open = vec![(0_usize, None, 0_usize, 1_usize)];
        while let Some((root, slot, stacked, depth)) = open.pop() {
            let parts = self.split(root);
            let index = tree.nodes.len();
            if let Some((parent, lane)) = slot {
                let parent: &mut Node8 = &mut tree.nodes[parent];
                parent.children[lane] = Child::node(index);
            }
            let stacked = stacked + parts.len() - 1;
            tree.max_stack = tree.max_stack.max(stacked + 1);
            tree.depth = tree.depth.max(depth);
            let mut children = Vec::with_capacity(LANES);
            for (lane, &part) in parts.iter().enumerate() {
                let bounds = *self.binary.nodes[part].aabb();
                if self.fits(part) {
                    children.push((bounds, Child::packet(tree.packets.len())));
                    tree.packets.push(self.pack(part));
                } else {
                    children.push((bounds, Child::NONE));
                    open.push((part, Some((index, lane)), stacked, depth + 1));
                }
            }
            tree.nodes.push(Node8::new(children));
        }
        tree
    }

    fn fits(&self, at: usize) -> bool {
        self.counts[at] as usize <= LANES
    }

    /// Opens `root` into up to eight parts, always the largest that does not fit into a packet.
    fn split(&self, root: usize) -> Vec<usize> {
        let mut parts = vec![root];
        while parts.len() < LANES {
            let area = |&k: &usize| self.binary.nodes[parts[k]].aabb().half_area();
            let widest = (0..parts.len())
                .filter(|&k| !self.fits(parts[k]))
                .max_by(|i, j| area(i).total_cmp(&area(j)).then(j.cmp(i)));
            let Some(widest) = widest else { break };
            let first = self.binary.nodes[parts[widest]].first_index as usize;
            parts[widest] = first;
            parts.push(first + 1);
        }
        parts
    }

    fn pack(&self, root: usize) -> Triangle8 {
        let mut faces = Vec::with_capacity(LANES);
        let mut stack = vec![root];
        while let Some(at) = stack.pop() {
            let node = &self.binary.nodes[at];
            let first = node.first_index as usize;
            if node.is_leaf() {
                let range = first..first + node.prim_count as usize;
                faces.extend(self.binary.primitive_indices[range].iter().map(|&f| FaceId::from(f)));
            } else {
                stack.extend([first, first + 1]);
            }
        }
        faces.sort_unstable();
        let triangles: Vec<_> = faces.into_iter().map(|f| (f, self.triangles[f])).collect();
        Triangle8::new(&triangles)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{TriMesh, shapes};

    fn corners(mesh: &TriMesh) -> IdVec<FaceId, [DVec3; 3]> {
        mesh.triangles.ids().map(|face| mesh.corners(face)).collect()
    }

    /// Faces below a child, all of whose corners must lie in `lo` to `hi`.
    fn faces_below(
        tree: &Bvh8,
        child: Child,
        (lo, hi): (DVec3, DVec3),
        triangles: &IdVec<FaceId, [DVec3; 3]>,
    ) -> Vec<FaceId> {
        match child.target() {
            Target::Packet(packet) => {
                let packet = &tree.packets[packet];
                let faces: Vec<_> = (0..LANES)
                    .filter(|lane| packet.used >> lane & 1 == 1)
                    .map(|lane| packet.faces[lane])
                    .collect();
                for p in faces.iter().flat_map(|&face| triangles[face]) {
                    assert!(p.cmpge(lo).all() && p.cmple(hi).all(), "{p} lies in its box {lo} to {hi}");
                }
                faces
            }
            Target::Node(node) => {
                let node = &tree.nodes[node];
                let slots = (0..LANES).filter(|&lane| node.children[lane] != Child::NONE);
                slots
                    .flat_map(|lane| faces_below(tree, node.children[lane], node.bounds(lane), triangles))
                    .collect()
            }
        }
    }

    #[test]
    fn each_face_is_below_the_root_once_and_inside_of_all_boxes_above_it() {
        let stacked = |n: usize| {
            TriMesh::from_arrays(shapes::triangle().positions.iter().copied().collect(), &vec![[0, 1, 2]; n])
        };
        for mesh in
            [shapes::triangle(), shapes::fan(8), shapes::cap(3000, 0.5, 1.9), stacked(9), stacked(500)]
        {
            let triangles = corners(&mesh);
            let tree = Bvh8::new(&triangles);
            let everywhere = (DVec3::NEG_INFINITY, DVec3::INFINITY);
            let mut faces = faces_below(&tree, Child::ROOT, everywhere, &triangles);
            faces.sort_unstable();
            assert_eq!(faces, mesh.triangles.ids().collect::<Vec<_>>());
        }
    }

    #[test]
    fn distances_to_boxes_are_those_of_f64_and_empty_slots_are_infinitely_far() {
        let boxes: Vec<Aabb> = [-1.0, 0.25, 2.0]
            .map(|x| enclose([DVec3::new(x, 0.0, 0.0), DVec3::new(x + 0.5, 1.0, 0.25)]))
            .into();
        let nodes = Node8::rows(&boxes);
        let q = DVec3::new(0.5, -1.0, 0.5);
        let squared =
            nodes[0].distance_squared(&crate::contact::search::lanes::splat(q.as_vec3())).to_array();
        for (lane, found) in squared.into_iter().enumerate() {
            let expected = if lane < boxes.len() {
                let (lo, hi) = nodes[0].bounds(lane);
                q.distance_squared(q.clamp(lo, hi))
            } else {
                f64::INFINITY
            };
            assert_eq!(f64::from(found), expected, "lane {lane}");
        }
    }

    #[test]
    fn boxes_are_rounded_outwards() {
        let p = DVec3::new(0.1, -0.1, 1.0 / 3.0);
        let Aabb { min, max } = enclose([p]);
        assert!(min.as_dvec3().cmple(p).all() && max.as_dvec3().cmpge(p).all(), "{min} to {max} holds {p}");
    }
}
