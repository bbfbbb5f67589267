//! A tree of oriented boxes, eight to a node, over packets of eight primitives: triangles or points.
//!
//! Built from the top: a node's primitives are halved by count, always the largest group along its longest
//! axis, until there are eight groups. So the tree is never deeper than the logarithm of their number,
//! coincident primitives or not, and all packets but a few are full. Its boxes are fitted in one pass from
//! the packets up: when the tree is built, and when the skin bends.

use std::ops::Range;

use arrayvec::ArrayVec;
use glam::{DMat3, DVec2, DVec3};

use crate::Aabb;
use crate::lanes::{Kernel, LANES, Lanes, Simd, most_of_rows};
use crate::node8::{Around, Boxes, Child, EMPTY, Node8, Target};

/// Primitives of one tree, at most: numbers of nodes and packets must not use a child's top bit, and the
/// depth must not exceed [`DEPTH`].
pub(crate) const MAX_PRIMITIVES: usize = 1 << 28;

/// Nodes on the longest path from the root to a packet: every node has at most an eighth of the primitives of
/// the one above it, rounded up to packets. One is spare.
pub(crate) const DEPTH: usize = 12;

/// Most entries on the stack of a traversal: seven children of each node on the path. Stacks are
/// `ArrayVec`s: arrays were cleared for each query, which took 25 of the 371 ns of a reactive answer.
pub(crate) const STACK: usize = 7 * DEPTH + 1;

/// If the normals of a group of primitives cancel to less than this share of its area, it is not thin in any
/// direction.
pub(crate) const FLAT: f64 = 0.25;

/// The nodes of a tree, and the primitives of its packets.
#[derive(Debug, Clone)]
pub(crate) struct Tree {
    /// The root first; every node before those below it.
    pub(crate) nodes: Vec<Node8>,
    /// Primitives of each packet, ascending; the last one is repeated in empty lanes.
    pub(crate) packets: Vec<[u32; LANES]>,
    /// The node above each packet.
    pub(crate) owners: Vec<u32>,
}

#[derive(Debug, Clone, Copy)]
pub(crate) struct Primitive {
    pub(crate) centre: DVec3,
    /// Normal of the skin there, with its area as the length.
    pub(crate) area: DVec3,
}

/// The primitives of a packet, each once.
pub(crate) fn distinct(packet: &[u32; LANES]) -> impl Iterator<Item = u32> + '_ {
    let repeated = |lane: usize| lane > 0 && packet[lane] == packet[lane - 1];
    (0..LANES).filter(move |&lane| !repeated(lane)).map(|lane| packet[lane])
}

impl Tree {
    /// A tree over at least one and at most [`MAX_PRIMITIVES`], whose boxes are still to be [fitted](Self::fit).
    #[expect(clippy::cast_possible_truncation, reason = "fewer nodes and packets than MAX_PRIMITIVES")]
    pub(crate) fn new(primitives: &[Primitive]) -> Self {
        let mut order: Vec<u32> = (0..primitives.len() as u32).collect();
        let mut tree = Self { nodes: vec![Node8::default()], packets: Vec::new(), owners: Vec::new() };
        let mut open = vec![(0_usize, 0..primitives.len(), None)];
        while let Some((index, range, above)) = open.pop() {
            let axes =
                Moments::of(order[range.clone()].iter().map(|&id| primitives[id as usize])).axes(above);
            let mut parts = split(primitives, &mut order, range, &axes);
            // Nodes first; nodes and packets keep their order.
            parts.sort_by_key(|part| part.len() <= LANES);
            let nodes = parts.iter().filter(|part| part.len() > LANES).count();
            let first = tree.nodes.len();
            let children = [first as u32, tree.packets.len() as u32];
            let above = tree.nodes[index].above;
            tree.nodes[index] = Node8::new(above, children, nodes as u8, parts.len() as u8, &axes);
            tree.nodes.resize(first + nodes, Node8::below(index as u32));
            tree.owners.resize(tree.packets.len() + parts.len() - nodes, index as u32);
            for (k, part) in parts.into_iter().enumerate() {
                if k < nodes {
                    open.push((first + k, part, Some(axes)));
                } else {
                    let mut ids = order[part].to_vec();
                    ids.sort_unstable();
                    tree.packets.push(std::array::from_fn(|lane| ids[lane.min(ids.len() - 1)]));
                }
            }
        }
        tree
    }

    /// A traversal in `f64`, for queries that do not use eight lanes.
    ///
    /// Visits every packet whose key is not above a bound, the least key first where it can.
    ///
    /// `keys` gives a lower bound for each child of a node, infinite to skip it; `visit` handles a packet and
    /// returns the new bound. Nothing is allocated.
    pub(crate) fn walk(
        &self,
        mut bound: f64,
        keys: impl Fn(&Node8) -> [f64; LANES],
        mut visit: impl FnMut(&[u32; LANES]) -> f64,
    ) {
        let mut stack = ArrayVec::<_, STACK>::new();
        stack.push((0.0, Child::ROOT));
        while let Some((key, at)) = stack.pop() {
            if key > bound {
                continue;
            }
            match at.target() {
                Target::Packet(packet) => bound = visit(&self.packets[packet]),
                Target::Node(index) => {
                    let node = &self.nodes[index];
                    let first = stack.len();
                    for (lane, key) in keys(node).into_iter().enumerate() {
                        if key <= bound && key < f64::INFINITY {
                            stack.push((key, node.child(lane)));
                        }
                    }
                    stack[first..].sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
                }
            }
        }
    }
}

/// Splits a range of the order into up to eight parts, by reordering it.
fn split(
    primitives: &[Primitive],
    order: &mut [u32],
    range: Range<usize>,
    axes: &DMat3,
) -> Vec<Range<usize>> {
    let mut parts = vec![range];
    while parts.len() < LANES {
        let largest = (0..parts.len()).max_by_key(|&k| (parts[k].len(), usize::MAX - k));
        let Some(largest) = largest.filter(|&k| parts[k].len() > LANES) else { break };
        let part = parts[largest].clone();
        let ids = &mut order[part.clone()];
        let around = Aabb::around(ids.iter().map(|&id| *axes * primitives[id as usize].centre));
        let axis = axes.row((around.hi - around.lo).max_position());
        // Whole packets on the left.
        let half = ids.len().div_ceil(LANES).div_ceil(2) * LANES;
        let middle = half.min(ids.len() - 1);
        let along = |id: &u32| primitives[*id as usize].centre.dot(axis);
        ids.select_nth_unstable_by(middle, |i, j| along(i).total_cmp(&along(j)).then(i.cmp(j)));
        parts[largest] = part.start..part.start + middle;
        parts.insert(largest + 1, part.start + middle..part.end);
    }
    parts
}

/// Sums over a set of primitives that determine its axes.
#[derive(Debug, Clone, Copy, Default)]
struct Moments {
    count: f64,
    area: DVec3,
    /// Sum of the areas without direction.
    total: f64,
    centre: DVec3,
    /// Sums of the products of coordinates: `xx, yy, zz` and `yz, zx, xy`.
    squares: DVec3,
    products: DVec3,
}

impl Moments {
    fn of(primitives: impl Iterator<Item = Primitive>) -> Self {
        let mut all = Self::default();
        for Primitive { centre: c, area } in primitives {
            all.count += 1.0;
            all.area += area;
            all.total += area.length();
            all.centre += c;
            all.squares += c * c;
            all.products += DVec3::new(c.y * c.z, c.z * c.x, c.x * c.y);
        }
        all
    }

    /// Rows: two axes along the skin, and its mean normal; the tree's axes where the normals cancel.
    /// The first is that of the node `above`, or the direction in which the primitives extend
    /// farthest.
    fn axes(&self, above: Option<DMat3>) -> DMat3 {
        let length = self.area.length();
        if length.is_nan() || length <= FLAT * self.total {
            return DMat3::IDENTITY;
        }
        let z = self.area / length;
        let x = above.map_or_else(|| self.longest_across(z), |above| above.row(0));
        let x = x.reject_from_normalized(z).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
        DMat3::from_cols(x, z.cross(x), z).transpose()
    }

    /// The direction at right angles to `z` in which the primitives extend farthest.
    fn longest_across(&self, z: DVec3) -> DVec3 {
        let (x, y) = z.any_orthonormal_pair();
        let mean = self.centre / self.count;
        let spread = self.squares / self.count - mean * mean;
        let mixed =
            self.products / self.count - DVec3::new(mean.y * mean.z, mean.z * mean.x, mean.x * mean.y);
        let covariance = DMat3::from_cols(
            DVec3::new(spread.x, mixed.z, mixed.y),
            DVec3::new(mixed.z, spread.y, mixed.x),
            DVec3::new(mixed.y, mixed.x, spread.z),
        );
        let (to_x, to_y) = (covariance * x, covariance * y);
        let turn = DVec2::from_angle(0.5 * (2.0 * x.dot(to_y)).atan2(x.dot(to_x) - y.dot(to_y)));
        x * turn.x + y * turn.y
    }
}

/// Points of the primitives of a packet, in the tree's units: coordinate `c` of point `k` of every
/// primitive is in `[k][c]`.
pub(crate) type Points<const N: usize> = [[[f32; LANES]; 3]; N];

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
pub(crate) fn put<const N: usize>(points: &mut Points<N>, lane: usize, primitive: [DVec3; N]) {
    for (point, p) in points.iter_mut().zip(primitive) {
        (point[0][lane], point[1][lane], point[2][lane]) = (p.x as f32, p.y as f32, p.z as f32);
    }
}

/// A node's box is fitted to those of the nodes this many levels below its child. They are fewer than the
/// packets, and rotated less often than the boxes of the child. On a cap of 100k triangles, bent or not, one
/// level fewer makes a search visit 6 % more nodes; the boxes of all packets would save 1 % of them, but take
/// a twelfth more time.
const LEVELS: usize = 2;

impl Tree {
    /// Fits all boxes to the primitives. `set` sets the points of those in a packet, by its number
    /// and theirs, and returns the sum of their areas with direction; it is called once for each
    /// packet. Nothing is allocated.
    ///
    /// The axes of a node turn with the mean normal of the skin below it. A packet's box follows its points;
    /// those of the nodes above follow boxes some levels below, since boxes fitted to rotated boxes would
    /// grow from level to level.
    pub(crate) fn fit<const N: usize>(
        &mut self,
        simd: Simd,
        mut set: impl FnMut(usize, &[u32; LANES], &mut Points<N>) -> DVec3,
    ) {
        let mut points = [[[[0.0; LANES]; 3]; N]; LANES];
        self.fit_node(simd, 0, &mut points, &mut set);
    }

    /// Fits a node and everything below it; returns the sum of the areas there with direction, and of the
    /// lengths of those of the packets. `points` is a buffer for those of the node's packets.
    fn fit_node<const N: usize>(
        &mut self,
        simd: Simd,
        index: usize,
        points: &mut [Points<N>; LANES],
        set: &mut impl FnMut(usize, &[u32; LANES], &mut Points<N>) -> DVec3,
    ) -> (DVec3, f64) {
        let node = self.nodes[index];
        let (mut area, mut total) = (DVec3::ZERO, 0.0);
        // The last first, which is the order of memory, since the nodes below the last child were numbered
        // first.
        for child in node.children().rev() {
            if let Target::Node(below) = child.target() {
                let (below, length) = self.fit_node(simd, below, points, set);
                (area, total) = (area + below, total + length);
            }
        }
        for (child, points) in node.children().zip(&mut *points) {
            if let Target::Packet(packet) = child.target() {
                let below = set(packet, &self.packets[packet], points);
                (area, total) = (area + below, total + below.length());
            }
        }
        let axes = turned(node.axes(), area, total);
        let boxes = self.around(simd, &node, &axes, LEVELS);
        simd.run(Fitting { node: &mut self.nodes[index], axes: &axes, boxes: &boxes, points });
        (area, total)
    }

    /// For each node below one the box along `axes` (rows) around the boxes `levels` farther down
    /// and around those of the packets above these.
    fn around(&self, simd: Simd, node: &Node8, axes: &DMat3, levels: usize) -> Boxes {
        let first = node.first_node as usize;
        let nodes = &self.nodes[first..first + usize::from(node.nodes)];
        if nodes.is_empty() {
            return EMPTY;
        }
        let mut boxes = simd.run(Around { nodes, axes, only_packets: levels > 0 });
        if levels > 0 {
            for (lane, node) in nodes.iter().enumerate().filter(|(_, node)| node.nodes > 0) {
                let below = self.around(simd, node, axes, levels - 1);
                for k in 0..3 {
                    boxes.lo[k][lane] = below.lo[k].into_iter().fold(boxes.lo[k][lane], f32::min);
                    boxes.hi[k][lane] = below.hi[k].into_iter().fold(boxes.hi[k][lane], f32::max);
                }
            }
        }
        boxes
    }
}

/// Fits a node to the boxes of the nodes below it and to the points of its packets.
struct Fitting<'a, const N: usize> {
    node: &'a mut Node8,
    axes: &'a DMat3,
    boxes: &'a Boxes,
    points: &'a [Points<N>; LANES],
}

impl<const N: usize> Kernel for Fitting<'_, N> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) {
        let Self { node, axes, boxes, points } = self;
        let packets = usize::from(node.nodes)..usize::from(node.count).min(LANES);
        let (mut lo, mut hi) = ([l.splat(0.0); 3], [l.splat(0.0); 3]);
        for k in 0..3 {
            let row = axes.row(k).as_vec3();
            let (x, y, z) = (l.splat(row.x), l.splat(row.y), l.splat(row.z));
            let (inf, sup) = (l.splat(f32::INFINITY), l.splat(f32::NEG_INFINITY));
            let (mut least, mut most) = ([inf; LANES], [sup; LANES]);
            for lane in packets.clone() {
                for point in &points[lane] {
                    let (px, py, pz) = (l.load(&point[0]), l.load(&point[1]), l.load(&point[2]));
                    let along = l.mul_add(x, px, l.mul_add(y, py, l.mul(z, pz)));
                    (least[lane], most[lane]) = (l.min(least[lane], along), l.max(most[lane], along));
                }
            }
            lo[k] = l.min(l.load(&boxes.lo[k]), l.least_of_rows(least));
            hi[k] = l.max(l.load(&boxes.hi[k]), most_of_rows(l, most));
        }
        node.fit(l, axes, lo, hi);
    }
}

/// Axes (rows) turned so that the third is along `area`, by the least rotation; unchanged where the normals
/// cancel.
fn turned(axes: DMat3, area: DVec3, total: f64) -> DMat3 {
    let length = area.length();
    let old = axes.row(2);
    let z = if length > FLAT * total { area / length } else { old.normalize_or(DVec3::Z) };
    let (x, middle) = (axes.row(0), old + z);
    let x = x - middle * (x.dot(z) / (1.0 + old.dot(z)).max(f64::MIN_POSITIVE));
    let x = x.reject_from_normalized(z).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
    DMat3::from_cols(x, z.cross(x), z).transpose()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::soup::sheet;

    /// Primitives below a child, all of whose corners must lie in its boxes.
    fn below(tree: &Tree, child: Child, corners: &[[DVec3; 3]], found: &mut Vec<u32>) {
        match child.target() {
            Target::Packet(packet) => found.extend(distinct(&tree.packets[packet])),
            Target::Node(index) => {
                let node = &tree.nodes[index];
                for lane in 0..usize::from(node.count) {
                    let first = found.len();
                    below(tree, node.child(lane), corners, found);
                    for p in found[first..].iter().flat_map(|&id| corners[id as usize]) {
                        assert_eq!(node.point_gaps(p)[lane], 0.0, "{p} lies in its box");
                    }
                }
            }
        }
    }

    #[test]
    fn each_primitive_is_below_the_root_once_and_inside_of_all_boxes_above_it() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let cap = sheet(140, 140, |p| DVec3::new(p.x, p.y, -0.005 * (p - 70.0).length_squared()) / 100.0);
        for corners in
            [vec![triangle], sheet(2, 2, |p| p.extend(0.1)), cap, vec![triangle; 9], vec![triangle; 5000]]
        {
            let primitive = |id: u32| {
                let [a, b, c] = corners[id as usize];
                Primitive { centre: (a + b + c) / 3.0, area: (b - a).cross(c - a) }
            };
            let count = u32::try_from(corners.len()).unwrap();
            let mut tree = Tree::new(&(0..count).map(primitive).collect::<Vec<_>>());
            tree.fit(Simd::detect(), |_, ids, points: &mut Points<3>| {
                ids.iter().enumerate().for_each(|(lane, &id)| put(points, lane, corners[id as usize]));
                DVec3::Z
            });
            let mut found = Vec::new();
            below(&tree, Child::ROOT, &corners, &mut found);
            found.sort_unstable();
            assert_eq!(found, (0..count).collect::<Vec<_>>());
        }
    }
}
