//! Fitting the boxes of a tree to its primitives, in one pass from the packets up: when the tree is
//! built, and when the skin bends.

use glam::{DMat3, DVec3};

use crate::{
    lanes::{Kernel, LANES, Lanes, Simd, most_of_rows},
    node8::{Around, Boxes, EMPTY, Node8, Target},
    tree::{FLAT, Tree},
};

/// Points of the primitives of a packet, in the tree's units: coordinate `c` of point `k` of every
/// primitive is in `[k][c]`.
pub(crate) type Points<const N: usize> = [[[f32; LANES]; 3]; N];

/// Sets the points of the primitive in one lane.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
pub(crate) fn put<const N: usize>(points: &mut Points<N>, lane: usize, primitive: [DVec3; N]) {
    for (point, p) in points.iter_mut().zip(primitive) {
        (point[0][lane], point[1][lane], point[2][lane]) = (p.x as f32, p.y as f32, p.z as f32);
    }
}

/// A node's box is fitted to those of the nodes this many levels below its child. There are fewer
/// of them than of packets, and they are turned less often than those of the child. On a cap of 100k
/// triangles, bent or not, one level fewer makes a search visit 6 % more nodes; the boxes of all
/// packets would spare 1 % of them, and take a twelfth more time.
const LEVELS: usize = 2;

impl Tree {
    /// Fits all boxes to the primitives. `set` sets the points of those in a packet, by its number
    /// and theirs, and returns the sum of their areas with direction; it is called once for each
    /// packet. Nothing is allocated.
    ///
    /// The axes of a node turn with the mean normal of the skin below it. A packet's box follows its
    /// points; those of the nodes above follow boxes some levels below, not those of their
    /// children, whose turned boxes would grow from level to level.
    pub(crate) fn fit<const N: usize>(
        &mut self,
        simd: Simd,
        mut set: impl FnMut(usize, &[u32; LANES], &mut Points<N>) -> DVec3,
    ) {
        let mut points = [[[[0.0; LANES]; 3]; N]; LANES];
        self.fit_node(simd, 0, &mut points, &mut set);
    }

    /// Fits a node and what is below it: the sum of the areas there with direction, and of the
    /// lengths of those of the packets. `points` is room for those of the node's packets.
    fn fit_node<const N: usize>(
        &mut self,
        simd: Simd,
        index: usize,
        points: &mut [Points<N>; LANES],
        set: &mut impl FnMut(usize, &[u32; LANES], &mut Points<N>) -> DVec3,
    ) -> (DVec3, f64) {
        let node = self.nodes[index];
        let (mut area, mut total) = (DVec3::ZERO, 0.0);
        // The last first: in the order of memory, since what is below the last child was numbered
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

/// Axes (rows) turned so that the third is along `area`, about no more than that needs; as they are
/// where the normals cancel.
fn turned(axes: DMat3, area: DVec3, total: f64) -> DMat3 {
    let length = area.length();
    let old = axes.row(2);
    let z = if length > FLAT * total { area / length } else { old.normalize_or(DVec3::Z) };
    let (x, middle) = (axes.row(0), old + z);
    let x = x - middle * (x.dot(z) / (1.0 + old.dot(z)).max(f64::MIN_POSITIVE));
    let x = x.reject_from_normalized(z).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
    DMat3::from_cols(x, z.cross(x), z).transpose()
}
