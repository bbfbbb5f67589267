//! A node of the tree: up to eight boxes along axes of its own, in 128 bytes.
//!
//! *Heuristic*: the axes follow the skin. A contact is some height `h` off the skin, and a box of
//! thickness `t` is within reach as far as `sqrt(2 h t)` sideways. Along fixed axes the boxes of
//! slanted skin are as thick as wide; along the skin's mean normal they are as thin as it is curved.
//! On a cap of 1M triangles that leaves 2.9 instead of 9.6 packets to be compared with each contact.

use std::ops::Range;

use glam::{DMat3, DVec3};

use super::{
    lanes::{Kernel, LANES, Lanes, Simd, least_of, most_of},
    rounding::slack,
};
use crate::contact::geometry::Ray;

/// Steps of a node's boxes along each axis.
const STEPS: f64 = 254.0;

/// Boxes are at least this thick in all, in the tree's units: a step's inverse stays in `f32`.
const THINNEST: f64 = 1e-7;

/// A box, `(min, max)` along axes that belong to it.
pub(super) type Extent = (DVec3, DVec3);

/// Where a child of a node leads: to a node or to a packet.
pub(super) enum Target {
    Node(usize),
    Packet(usize),
}

/// A node or (top bit) a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Child(pub(super) u32);

/// Children that are packets have this bit.
const PACKET: u32 = 1 << 31;

impl Child {
    pub(super) const ROOT: Self = Self(0);

    #[inline(always)]
    pub(super) fn packet(packet: u32) -> Self {
        Self(PACKET | packet)
    }

    #[inline(always)]
    pub(super) fn target(self) -> Target {
        if self.0 & PACKET == 0 {
            Target::Node(self.0 as usize)
        } else {
            Target::Packet((self.0 & !PACKET) as usize)
        }
    }
}

/// Up to eight boxes, in whole steps of a frame of their own.
#[derive(Debug, Clone, Copy, Default)]
#[repr(C, align(64))]
pub(super) struct Node8 {
    /// Columns of the way from the tree's frame into steps of the node's: three axes and the shift.
    /// The fourth row has the squared steps along the three axes.
    frame: [[f32; 4]; 4],
    lo: [[u8; LANES]; 3],
    hi: [[u8; LANES]; 3],
    pub(super) first_node: u32,
    pub(super) first_packet: u32,
    /// The node above; the root's is the root.
    pub(super) above: u32,
    /// The first `nodes` children are nodes, the others up to `count` are packets.
    pub(super) nodes: u8,
    pub(super) count: u8,
}

impl Node8 {
    /// A node below another one, whose boxes and children are still to be set.
    pub(super) fn below(above: u32) -> Self {
        Self { above, ..Self::default() }
    }

    /// A node without boxes, whose children begin at `first_node` and `first_packet`.
    pub(super) fn new(
        above: u32,
        [first_node, first_packet]: [u32; 2],
        nodes: u8,
        count: u8,
        axes: &DMat3,
    ) -> Self {
        let mut node = Self { first_node, first_packet, above, nodes, count, ..Self::default() };
        node.place(axes, DVec3::ZERO, DVec3::ONE);
        node
    }

    /// Lays the steps along `axes` (rows), from the corner `lo`.
    #[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
    fn place(&mut self, axes: &DMat3, lo: DVec3, step: DVec3) {
        for k in 0..3 {
            let row = axes.row(k) / step[k];
            for c in 0..3 {
                self.frame[c][k] = row[c] as f32;
            }
            self.frame[3][k] = (-lo[k] / step[k]) as f32;
            self.frame[k][3] = (step[k] * step[k]) as f32;
        }
    }

    /// Its axes: rows of about unit length, about at right angles.
    pub(super) fn axes(&self) -> DMat3 {
        let step = self.step();
        DMat3::from_diagonal(step) * DMat3::from_cols(self.column(0), self.column(1), self.column(2))
    }

    /// Fits the boxes to those of the children, `lo` to `hi` along `axes` (rows); they are rounded
    /// outwards.
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a byte")]
    pub(super) fn fit(&mut self, axes: &DMat3, children: &[(DVec3, DVec3)]) {
        let Some(&first) = children.first() else { return };
        let (lo, hi) = children.iter().fold(first, |(lo, hi), b| (lo.min(b.0), hi.max(b.1)));
        let step = ((hi - lo) / STEPS).max(DVec3::splat(THINNEST));
        self.place(axes, lo, step);
        let per_step = step.recip();
        for lane in 0..LANES {
            // An empty slot is a point of the first box, and so never the nearest.
            let (low, high) = children.get(lane).map_or((first.0, first.0), |b| *b);
            let (low, high) = ((low - lo) * per_step, (high - lo) * per_step);
            for k in 0..3 {
                let (down, up) = (low[k] as u8, high[k] as u8);
                let is_cut = lane < children.len() && f64::from(up) < high[k];
                self.lo[k][lane] = down;
                self.hi[k][lane] = up.saturating_add(u8::from(is_cut));
            }
        }
    }

    /// The box along `axes` (rows) around those of the packets.
    pub(super) fn around_packets(&self, simd: Simd, axes: &DMat3) -> Extent {
        simd.run(AroundPackets(self, axes))
    }

    #[inline(always)]
    pub(super) fn child(&self, lane: usize) -> Child {
        #[expect(clippy::cast_possible_truncation, reason = "below eight")]
        let lane = lane as u32;
        let nodes = u32::from(self.nodes);
        if lane < nodes {
            Child(self.first_node + lane)
        } else {
            Child(PACKET | (self.first_packet + (lane - nodes)))
        }
    }

    /// One bit for the lane of a child.
    #[inline(always)]
    pub(super) fn lane_bit(&self, child: Child) -> u32 {
        let lane = if child.0 & PACKET == 0 {
            child.0 - self.first_node
        } else {
            u32::from(self.nodes) + (child.0 & !PACKET) - self.first_packet
        };
        1 << (lane & 7)
    }

    pub(super) fn children(&self) -> impl DoubleEndedIterator<Item = Child> + ExactSizeIterator + use<> {
        let node = *self;
        (0..usize::from(node.count)).map(move |lane| node.child(lane))
    }

    /// One bit for each lane in use.
    #[inline(always)]
    pub(super) fn used(&self) -> u32 {
        (1 << self.count) - 1
    }

    /// Squared distances of `q` to the boxes; an empty slot is never nearer than the first box.
    #[inline(always)]
    pub(super) fn distance_squared<L: Lanes>(&self, l: L, q: [f32; 3]) -> L::F {
        let p = l.affine(&self.frame, q);
        let x = outside(l, &self.lo[0], &self.hi[0], p[0]);
        let y = outside(l, &self.lo[1], &self.hi[1], p[1]);
        let z = outside(l, &self.lo[2], &self.hi[2], p[2]);
        let (xx, yy, zz) = (l.splat(self.frame[0][3]), l.splat(self.frame[1][3]), l.splat(self.frame[2][3]));
        l.mul_add(l.mul(xx, x), x, l.mul_add(l.mul(yy, y), y, l.mul(l.mul(zz, z), z)))
    }
}

struct AroundPackets<'a>(&'a Node8, &'a DMat3);

impl Kernel for AroundPackets<'_> {
    type Output = Extent;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Extent {
        let Self(node, axes) = self;
        let step = node.step();
        // Rows of the frame are axes over steps.
        let to_steps = DMat3::from_cols(node.column(0), node.column(1), node.column(2));
        let turn = *axes * (to_steps.transpose() * DMat3::from_diagonal(step * step));
        let shift = (turn * node.column(3)).as_vec3();
        let packets = usize::from(node.nodes)..usize::from(node.count);
        let half = l.splat(0.5);
        let (mut centre, mut size) = ([half; 3], [half; 3]);
        for k in 0..3 {
            let (lo, hi) = (l.bytes(&node.lo[k]), l.bytes(&node.hi[k]));
            (centre[k], size[k]) = (l.mul(half, l.add(lo, hi)), l.mul(half, l.sub(hi, lo)));
        }
        let (mut lo, mut hi) = (DVec3::ZERO, DVec3::ZERO);
        for k in 0..3 {
            let row = turn.row(k).as_vec3();
            let (x, y, z) = (l.splat(row.x), l.splat(row.y), l.splat(row.z));
            let middle = l.mul_add(x, centre[0], l.mul_add(y, centre[1], l.mul(z, centre[2])));
            let middle = l.sub(middle, l.splat(shift[k]));
            let (x, y, z) = (l.splat(row.x.abs()), l.splat(row.y.abs()), l.splat(row.z.abs()));
            let extent = l.mul_add(x, size[0], l.mul_add(y, size[1], l.mul(z, size[2])));
            let (low, high) = (l.store(l.sub(middle, extent)), l.store(l.add(middle, extent)));
            lo[k] = f64::from(least_of(among(&low, &packets, f32::INFINITY)));
            hi[k] = f64::from(most_of(among(&high, &packets, f32::NEG_INFINITY)));
        }
        (lo, hi)
    }
}

/// The numbers of some lanes, and `other` in the other lanes.
#[inline(always)]
fn among(numbers: &[f32; LANES], lanes: &Range<usize>, other: f32) -> [f32; LANES] {
    let mut all = [other; LANES];
    for lane in 0..LANES {
        all[lane] = if lane >= lanes.start && lane < lanes.end { numbers[lane] } else { other };
    }
    all
}

/// How far, in steps, `p` is outside of the intervals `lo` to `hi`.
#[inline(always)]
fn outside<L: Lanes>(l: L, lo: &[u8; LANES], hi: &[u8; LANES], p: L::F) -> L::F {
    l.max(l.max(l.sub(l.bytes(lo), p), l.sub(p, l.bytes(hi))), l.splat(0.0))
}

/// The same in `f64`, for the queries that need no eight lanes.
impl Node8 {
    fn column(&self, k: usize) -> DVec3 {
        let [x, y, z, _] = self.frame[k].map(f64::from);
        DVec3::new(x, y, z)
    }

    fn step(&self) -> DVec3 {
        DVec3::from([0, 1, 2].map(|k: usize| f64::from(self.frame[k][3]).sqrt()))
    }

    fn vector(&self, v: DVec3) -> DVec3 {
        self.column(0) * v.x + self.column(1) * v.y + self.column(2) * v.z
    }

    fn steps(&self, lane: usize) -> (DVec3, DVec3) {
        let pick = |rows: &[[u8; LANES]; 3]| DVec3::from([0, 1, 2].map(|k: usize| f64::from(rows[k][lane])));
        (pick(&self.lo), pick(&self.hi))
    }

    /// For each child a distance, in the tree's units, that nothing of it is nearer to the core of a
    /// volume; infinite for empty slots. `sides` lead from the core's centre to its faces.
    pub(super) fn gaps(&self, centre: DVec3, sides: &[DVec3; 3]) -> [f64; LANES] {
        let (at, step) = (self.vector(centre) + self.column(3), self.step());
        let extent: DVec3 = sides.iter().map(|&side| self.vector(side).abs()).sum();
        let reach = centre.length() + sides.iter().map(|side| side.length()).sum::<f64>();
        let slack = slack(reach, 1.0);
        let mut gaps = [f64::INFINITY; LANES];
        for (lane, gap) in gaps.iter_mut().enumerate().take(usize::from(self.count)) {
            let (lo, hi) = self.steps(lane);
            let outside = ((lo - at).max(at - hi) - extent).max(DVec3::ZERO);
            *gap = ((outside * step).length() - slack).max(0.0);
        }
        gaps
    }

    /// The same for a point so far away that `f32` cannot distinguish the boxes: by the spheres
    /// around them.
    pub(super) fn far_gaps(&self, q: DVec3) -> [f64; LANES] {
        let step = self.step();
        let mut gaps = [f64::INFINITY; LANES];
        for (lane, gap) in gaps.iter_mut().enumerate().take(usize::from(self.count)) {
            let (lo, hi) = self.steps(lane);
            let middle = (lo.midpoint(hi) - self.column(3)) * step * step;
            // Rows of the frame are axes over steps: their transpose leads back.
            let [x, y, z] = [self.column(0), self.column(1), self.column(2)].map(|c| c.dot(middle));
            let radius = ((hi - lo) * step).length() * 0.5 + slack(1.0, 1.0);
            *gap = (q.distance(DVec3::new(x, y, z)) * (1.0 - 1e-15) - radius).max(0.0);
        }
        gaps
    }

    /// For each child how far along a ray, in the tree's frame and units, its box begins; infinite
    /// where the ray misses it.
    pub(super) fn entries(&self, ray: &Ray) -> [f64; LANES] {
        let (at, along) = (self.vector(ray.origin) + self.column(3), self.vector(ray.direction));
        let margin = slack(ray.origin.length(), 1.0) / self.step();
        let mut entries = [f64::INFINITY; LANES];
        for (lane, entry) in entries.iter_mut().enumerate().take(usize::from(self.count)) {
            let (lo, hi) = self.steps(lane);
            let (lo, hi) = (lo - margin - at, hi + margin - at);
            let (mut enter, mut leave) = (0.0_f64, ray.longest);
            for k in 0..3 {
                if along[k] != 0.0 {
                    let (a, b) = (lo[k] / along[k], hi[k] / along[k]);
                    (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
                } else if lo[k] > 0.0 || hi[k] < 0.0 {
                    leave = f64::NEG_INFINITY;
                }
            }
            if enter <= leave {
                *entry = enter;
            }
        }
        entries
    }
}
