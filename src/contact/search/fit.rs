//! Fitting the boxes of a tree to its primitives, in one pass from the packets up: when the tree is
//! built, and when the skin bends.

use glam::{DMat3, DVec3};

use super::{
    lanes::LANES,
    node8::Target,
    tree::{FLAT, Tree},
};

/// Points of the primitives of a packet, in the tree's units: coordinate `c` of point `k` of every
/// primitive is in `[k][c]`.
pub(super) type Points<const N: usize> = [[[f64; LANES]; 3]; N];

/// Sets the points of the primitive in one lane.
#[inline(always)]
pub(super) fn put<const N: usize>(points: &mut Points<N>, lane: usize, primitive: [DVec3; N]) {
    for (point, p) in points.iter_mut().zip(primitive) {
        (point[0][lane], point[1][lane], point[2][lane]) = (p.x, p.y, p.z);
    }
}

/// What the node above a node needs to know of it.
#[derive(Clone, Copy)]
struct Fitted {
    /// Rows: the axes of its boxes.
    axes: DMat3,
    boxes: [(DVec3, DVec3); LANES],
    count: usize,
    /// Sum of the areas below it, with direction, and of the lengths of those of the packets.
    area: DVec3,
    total: f64,
}

const EMPTY: (DVec3, DVec3) = (DVec3::INFINITY, DVec3::NEG_INFINITY);

impl Fitted {
    const NONE: Self =
        Self { axes: DMat3::IDENTITY, boxes: [EMPTY; LANES], count: 0, area: DVec3::ZERO, total: 0.0 };

    /// The box along `axes` around its boxes.
    fn along(&self, axes: &DMat3) -> (DVec3, DVec3) {
        let turn = *axes * self.axes.transpose();
        let size = DMat3::from_cols(turn.x_axis.abs(), turn.y_axis.abs(), turn.z_axis.abs()) * 0.5;
        self.boxes[..self.count].iter().fold(EMPTY, |(lo, hi), b| {
            let (centre, half) = (turn * b.0.midpoint(b.1), size * (b.1 - b.0));
            (lo.min(centre - half), hi.max(centre + half))
        })
    }
}

impl Tree {
    /// Fits all boxes to the primitives. `gather` sets the points of those in a packet, and gives the
    /// sum of their areas with direction; each packet is asked for once. Nothing is allocated.
    ///
    /// The axes of a node turn with the mean normal of the skin below it. A packet's box follows its
    /// points, and that of a node the boxes two levels below it: turned boxes grow, and those
    /// nearer to the packets grow less.
    pub(super) fn fit<const N: usize>(
        &mut self,
        mut gather: impl FnMut(usize, &[u32; LANES], &mut Points<N>) -> DVec3,
    ) {
        let mut root = Fitted::NONE;
        self.fit_node(0, &mut gather, &mut root);
    }

    fn fit_node<const N: usize>(
        &mut self,
        index: usize,
        gather: &mut impl FnMut(usize, &[u32; LANES], &mut Points<N>) -> DVec3,
        fitted: &mut Fitted,
    ) {
        let node = self.nodes[index];
        let mut packets = [[[[0.0; LANES]; 3]; N]; LANES];
        let mut nodes = [Fitted::NONE; LANES];
        for (lane, child) in node.children().enumerate() {
            let (area, total) = match child.target() {
                Target::Node(below) => {
                    self.fit_node(below, gather, &mut nodes[lane]);
                    (nodes[lane].area, nodes[lane].total)
                }
                Target::Packet(packet) => {
                    let area = gather(packet, &self.packets[packet], &mut packets[lane]);
                    (area, area.length())
                }
            };
            fitted.area += area;
            fitted.total += total;
            fitted.count += 1;
        }
        fitted.axes = turned(node.axes(), fitted.area, fitted.total);
        for (lane, child) in node.children().enumerate() {
            fitted.boxes[lane] = match child.target() {
                Target::Node(_) => nodes[lane].along(&fitted.axes),
                Target::Packet(_) => around(&fitted.axes, &packets[lane]),
            };
        }
        self.nodes[index].fit(&fitted.axes, &fitted.boxes[..fitted.count]);
    }
}

/// The box along `axes` (rows) around points.
fn around<const N: usize>(axes: &DMat3, points: &Points<N>) -> (DVec3, DVec3) {
    let (mut lo, mut hi) = EMPTY;
    for k in 0..3 {
        let row = axes.row(k);
        let (mut least, mut most) = ([f64::INFINITY; LANES], [f64::NEG_INFINITY; LANES]);
        for [x, y, z] in points {
            for lane in 0..LANES {
                let along = row.x * x[lane] + row.y * y[lane] + row.z * z[lane];
                least[lane] = if along < least[lane] { along } else { least[lane] };
                most[lane] = if along > most[lane] { along } else { most[lane] };
            }
        }
        lo[k] = least.into_iter().fold(f64::INFINITY, f64::min);
        hi[k] = most.into_iter().fold(f64::NEG_INFINITY, f64::max);
    }
    (lo, hi)
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
