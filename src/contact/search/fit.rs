//! Fitting the boxes of a tree to its primitives, in one pass from the packets up: when the tree is
//! built, and when the skin bends.

use glam::{DMat3, DVec3};

use super::{
    lanes::{Kernel, LANES, Lanes, Simd, least_of, most_of},
    node8::{Extent, Target},
    tree::{FLAT, Tree},
};

/// Points of the primitives of a packet, in the tree's units: coordinate `c` of point `k` of every
/// primitive is in `[k][c]`.
pub(super) type Points<const N: usize> = [[[f32; LANES]; 3]; N];

/// Sets the points of the primitive in one lane.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
pub(super) fn put<const N: usize>(points: &mut Points<N>, lane: usize, primitive: [DVec3; N]) {
    for (point, p) in points.iter_mut().zip(primitive) {
        (point[0][lane], point[1][lane], point[2][lane]) = (p.x as f32, p.y as f32, p.z as f32);
    }
}

const EMPTY: Extent = (DVec3::INFINITY, DVec3::NEG_INFINITY);

impl Tree {
    /// Fits all boxes to the primitives. `gather` sets the points of those in a packet, by its
    /// number and theirs, from which `area` gives the sum of their areas with direction; each
    /// packet is asked for once. Nothing is allocated.
    ///
    /// The axes of a node turn with the mean normal of the skin below it. A packet's box follows its
    /// points; those of the nodes above follow the boxes of all packets below them, not of the nodes
    /// in between, whose turned boxes would grow from level to level.
    pub(super) fn fit<const N: usize>(
        &mut self,
        simd: Simd,
        gather: impl Fn(usize, &[u32; LANES], &mut Points<N>),
        mut area: impl FnMut(usize, &Points<N>) -> DVec3,
    ) {
        self.fit_node(simd, 0, &gather, &mut area);
    }

    /// Fits a node and what is below it: the sum of the areas there with direction, and of the
    /// lengths of those of the packets.
    fn fit_node<const N: usize>(
        &mut self,
        simd: Simd,
        index: usize,
        gather: &impl Fn(usize, &[u32; LANES], &mut Points<N>),
        area_of: &mut impl FnMut(usize, &Points<N>) -> DVec3,
    ) -> (DVec3, f64) {
        let node = self.nodes[index];
        let mut points = [[[[0.0; LANES]; 3]; N]; LANES];
        // All first: points just written one by one cannot be read at once without waiting.
        for (child, points) in node.children().zip(&mut points) {
            if let Target::Packet(packet) = child.target() {
                gather(packet, &self.packets[packet], points);
            }
        }
        let (mut area, mut total) = (DVec3::ZERO, 0.0);
        // The last first: in the order of memory, since what is below the last child was numbered
        // first.
        for (child, points) in node.children().zip(&points).rev() {
            match child.target() {
                Target::Node(below) => {
                    let (below, length) = self.fit_node(simd, below, gather, area_of);
                    (area, total) = (area + below, total + length);
                }
                Target::Packet(packet) => {
                    let below = area_of(packet, points);
                    total += below.length();
                    area += below;
                }
            }
        }
        let axes = turned(node.axes(), area, total);
        let mut boxes = [EMPTY; LANES];
        for ((child, points), fitted) in node.children().zip(&points).zip(&mut boxes) {
            match child.target() {
                Target::Node(below) => self.add_packets(simd, below, &axes, fitted),
                Target::Packet(_) => *fitted = simd.run(Around(&axes, points)),
            }
        }
        self.nodes[index].fit(&axes, &boxes[..usize::from(node.count)]);
        (area, total)
    }

    /// Enlarges a box along `axes` (rows) by those of all packets below a node.
    fn add_packets(&self, simd: Simd, index: usize, axes: &DMat3, sum: &mut Extent) {
        let node = &self.nodes[index];
        for child in node.children().take(usize::from(node.nodes)) {
            if let Target::Node(below) = child.target() {
                self.add_packets(simd, below, axes, sum);
            }
        }
        if node.count > node.nodes {
            let (lo, hi) = node.around_packets(simd, axes);
            *sum = (sum.0.min(lo), sum.1.max(hi));
        }
    }
}

/// The box along axes (rows) around points.
struct Around<'a, const N: usize>(&'a DMat3, &'a Points<N>);

impl<const N: usize> Kernel for Around<'_, N> {
    type Output = Extent;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Extent {
        let Self(axes, points) = self;
        let (mut lo, mut hi) = EMPTY;
        for k in 0..3 {
            let row = axes.row(k).as_vec3();
            let (x, y, z) = (l.splat(row.x), l.splat(row.y), l.splat(row.z));
            let (mut least, mut most) = (l.splat(f32::INFINITY), l.splat(f32::NEG_INFINITY));
            for point in points {
                let (px, py, pz) = (l.load(&point[0]), l.load(&point[1]), l.load(&point[2]));
                let along = l.mul_add(x, px, l.mul_add(y, py, l.mul(z, pz)));
                (least, most) = (l.min(least, along), l.max(most, along));
            }
            (lo[k], hi[k]) = (f64::from(least_of(l.store(least))), f64::from(most_of(l.store(most))));
        }
        (lo, hi)
    }
}

/// Axes (rows) turned so that the third is along `area`, about no more than that needs; as they are
/// where the normals cancel.
fn turned(axes: DMat3, area: DVec3, total: f64) -> DMat3 {
    let length = area.length();
    let old = axes.row(2).normalize_or(DVec3::Z);
    let z = if length > FLAT * total { area / length } else { old };
    let (x, middle) = (axes.row(0), old + z);
    let x = x - middle * (x.dot(z) / (1.0 + old.dot(z)).max(f64::MIN_POSITIVE));
    let x = x.reject_from_normalized(z).try_normalize().unwrap_or_else(|| z.any_orthonormal_vector());
    DMat3::from_cols(x, z.cross(x), z).transpose()
}
