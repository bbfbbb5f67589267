//! A node of the tree: up to eight boxes along axes of its own, in 128 bytes.
//!
//! *Heuristic*: the axes follow the skin. For a contact at height `h` off the skin, boxes of thickness `t`
//! are within reach up to `sqrt(2 h t)` sideways. Along fixed axes the boxes of slanted skin are as thick as
//! wide; along the skin's mean normal their thickness is only that of its curvature. On a cap of 1M triangles
//! that leaves 2.9 instead of 9.6 packets to be compared with each contact.

use glam::{DMat3, DVec3};

use crate::Ray;
use crate::lanes::{Kernel, LANES, Lanes, most_of_rows};
use crate::scaling::{FAR, slack};

/// Steps of a node's boxes along each axis: less than 255, so that rounding up fits into a byte.
const STEPS: f64 = 254.99;

/// Least thickness of all boxes together, in the tree's units: the inverse of a step stays in `f32`.
const THINNEST: f64 = 1e-7;

/// Boxes around boxes are enlarged by this on all sides, in the tree's units: more than their rounding error,
/// so that errors do not add up from level to level.
const MARGIN: f32 = 16.0 / 16_777_216.0;

/// Boxes along the axes of a node, one a lane.
pub(crate) struct Boxes {
    pub(crate) lo: [[f32; LANES]; 3],
    pub(crate) hi: [[f32; LANES]; 3],
}

/// Boxes around nothing.
pub(crate) const EMPTY: Boxes =
    Boxes { lo: [[f32::INFINITY; LANES]; 3], hi: [[f32::NEG_INFINITY; LANES]; 3] };

const NUMBERS: [f32; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];

/// A child of a node: a node or a packet.
pub(crate) enum Target {
    Node(usize),
    Packet(usize),
}

/// A node or (top bit) a packet.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Child(pub(crate) u32);

/// Children that are packets have this bit.
const PACKET: u32 = 1 << 31;

impl Child {
    pub(crate) const ROOT: Self = Self(0);

    #[inline(always)]
    pub(crate) fn packet(packet: u32) -> Self {
        Self(PACKET | packet)
    }

    #[inline(always)]
    pub(crate) fn target(self) -> Target {
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
pub(crate) struct Node8 {
    /// Columns of the transformation from the tree's frame into steps of the node's: three axes and the shift.
    /// The fourth row has the squared steps along the three axes.
    frame: [[f32; 4]; 4],
    lo: [[u8; LANES]; 3],
    hi: [[u8; LANES]; 3],
    pub(crate) first_node: u32,
    pub(crate) first_packet: u32,
    /// The node above; the root's is the root.
    pub(crate) above: u32,
    /// The first `nodes` children are nodes, the others up to `count` are packets.
    pub(crate) nodes: u8,
    pub(crate) count: u8,
}

impl Node8 {
    /// A node below another one, whose boxes and children are still to be set.
    pub(crate) fn below(above: u32) -> Self {
        Self { above, ..Self::default() }
    }

    /// A node without boxes, whose children begin at `first_node` and `first_packet`.
    pub(crate) fn new(
        above: u32,
        [first_node, first_packet]: [u32; 2],
        nodes: u8,
        count: u8,
        axes: &DMat3,
    ) -> Self {
        let mut node = Self { first_node, first_packet, above, nodes, count, ..Self::default() };
        node.place(axes, DVec3::ZERO, DVec3::ONE, DVec3::ONE);
        node
    }

    /// Sets the frame: steps along `axes` (rows), from the corner `lo`.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
    fn place(&mut self, axes: &DMat3, lo: DVec3, per_step: DVec3, step: DVec3) {
        for k in 0..3 {
            let row = axes.row(k) * per_step[k];
            for c in 0..3 {
                self.frame[c][k] = row[c] as f32;
            }
            self.frame[3][k] = (-lo[k] * per_step[k]) as f32;
            self.frame[k][3] = (step[k] * step[k]) as f32;
        }
    }

    /// Its axes: rows of about unit length, about at right angles.
    pub(crate) fn axes(&self) -> DMat3 {
        let step = self.step();
        DMat3::from_diagonal(step) * DMat3::from_cols(self.column(0), self.column(1), self.column(2))
    }

    /// Fits the boxes to those of the children, one a lane, `lo` to `hi` along `axes` (rows); they
    /// are rounded outwards.
    #[inline(always)]
    #[expect(clippy::cast_possible_truncation, reason = "rounding is part of the search's slack")]
    pub(crate) fn fit<L: Lanes>(&mut self, l: L, axes: &DMat3, lo: [L::F; 3], hi: [L::F; 3]) {
        let (least, most) = extent(l, &lo, &hi);
        let (least, most) = (DVec3::from(least.map(f64::from)), DVec3::from(most.map(f64::from)));
        let step = ((most - least) / STEPS).max(DVec3::splat(THINNEST));
        let per_step = step.recip();
        self.place(axes, least, per_step, step);
        let used = (l.load(&NUMBERS), l.splat(f32::from(self.count) - 1.0));
        for k in 0..3 {
            // An empty slot is a point of the first box, and so never the nearest.
            let first = l.splat(l.store(lo[k])[0]);
            let low = l.select([used; 4], lo[k], first);
            let high = l.select([used; 4], hi[k], first);
            let (origin, per) = (l.splat(least[k] as f32), l.splat(per_step[k] as f32));
            self.lo[k] = l.whole(l.mul(l.sub(low, origin), per));
            self.hi[k] = l.whole(l.mul_add(l.sub(high, origin), per, l.splat(1.0)));
        }
    }

    #[inline(always)]
    pub(crate) fn child(&self, lane: usize) -> Child {
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
    pub(crate) fn lane_bit(&self, child: Child) -> u32 {
        let lane = if child.0 & PACKET == 0 {
            child.0 - self.first_node
        } else {
            u32::from(self.nodes) + (child.0 & !PACKET) - self.first_packet
        };
        1 << (lane & 7)
    }

    pub(crate) fn children(&self) -> impl DoubleEndedIterator<Item = Child> + ExactSizeIterator + use<> {
        let node = *self;
        (0..usize::from(node.count)).map(move |lane| node.child(lane))
    }

    /// One bit for each lane in use.
    #[inline(always)]
    pub(crate) fn used(&self) -> u32 {
        (1 << self.count) - 1
    }

    /// Squared distances of `q` to the boxes; an empty slot is never nearer than the first box.
    #[inline(always)]
    pub(crate) fn distance_squared<L: Lanes>(&self, l: L, q: [f32; 3]) -> L::F {
        let p = l.affine(&self.frame, q);
        let x = outside(l, &self.lo[0], &self.hi[0], p[0]);
        let y = outside(l, &self.lo[1], &self.hi[1], p[1]);
        let z = outside(l, &self.lo[2], &self.hi[2], p[2]);
        let (xx, yy, zz) = (l.splat(self.frame[0][3]), l.splat(self.frame[1][3]), l.splat(self.frame[2][3]));
        l.mul_add(l.mul(xx, x), x, l.mul_add(l.mul(yy, y), y, l.mul(l.mul(zz, z), z)))
    }
}

/// For each of some nodes, at most eight, the box along `axes` (rows) around those of its children.
pub(crate) struct Around<'a> {
    pub(crate) nodes: &'a [Node8],
    pub(crate) axes: &'a DMat3,
    /// Leaves children out that are nodes.
    pub(crate) only_packets: bool,
}

impl Kernel for Around<'_> {
    type Output = Boxes;

    #[inline(always)]
    fn run<L: Lanes>(self, l: L) -> Boxes {
        let Self { nodes, axes, only_packets } = self;
        let (inf, sup) = (l.splat(f32::INFINITY), l.splat(f32::NEG_INFINITY));
        let (half, margin, numbers) = (l.splat(0.5), l.splat(MARGIN), l.load(&NUMBERS));
        let (mut lo, mut hi) = ([[inf; LANES]; 3], [[sup; LANES]; 3]);
        for (lane, node) in nodes.iter().enumerate().take(LANES) {
            // Rows of the frame are axes over steps.
            let squares = [node.frame[0][3], node.frame[1][3], node.frame[2][3]].map(f64::from);
            let to_steps = DMat3::from_cols(node.column(0), node.column(1), node.column(2));
            let turn = *axes * (to_steps.transpose() * DMat3::from_diagonal(squares.into()));
            let shift = (turn * node.column(3)).as_vec3();
            let (mut centre, mut size) = ([half; 3], [half; 3]);
            for k in 0..3 {
                let (lo, hi) = (l.bytes(&node.lo[k]), l.bytes(&node.hi[k]));
                (centre[k], size[k]) = (l.mul(half, l.add(lo, hi)), l.mul(half, l.sub(hi, lo)));
            }
            let first = l.splat(if only_packets { f32::from(node.nodes) } else { 0.0 });
            let last = l.splat(f32::from(node.count) - 1.0);
            let asked = [(first, numbers), (numbers, last), (first, numbers), (numbers, last)];
            for k in 0..3 {
                let row = turn.row(k).as_vec3();
                let (x, y, z) = (l.splat(row.x), l.splat(row.y), l.splat(row.z));
                let middle = l.mul_add(x, centre[0], l.mul_add(y, centre[1], l.mul(z, centre[2])));
                let middle = l.sub(middle, l.splat(shift[k]));
                let (x, y, z) = (l.splat(row.x.abs()), l.splat(row.y.abs()), l.splat(row.z.abs()));
                let extent = l.mul_add(x, size[0], l.mul_add(y, size[1], l.mul_add(z, size[2], margin)));
                lo[k][lane] = l.select(asked, l.sub(middle, extent), inf);
                hi[k][lane] = l.select(asked, l.add(middle, extent), sup);
            }
        }
        let mut boxes = EMPTY;
        for k in 0..3 {
            boxes.lo[k] = l.store(l.least_of_rows(lo[k]));
            boxes.hi[k] = l.store(most_of_rows(l, hi[k]));
        }
        boxes
    }
}

/// The box around the boxes of all lanes.
#[inline(always)]
fn extent<L: Lanes>(l: L, lo: &[L::F; 3], hi: &[L::F; 3]) -> ([f32; 3], [f32; 3]) {
    let zero = l.splat(0.0);
    let minus = [l.sub(zero, hi[0]), l.sub(zero, hi[1]), l.sub(zero, hi[2])];
    let rows = [lo[0], lo[1], lo[2], minus[0], minus[1], minus[2], zero, zero];
    let [a, b, c, d, e, f, _, _] = l.store(l.least_of_rows(rows));
    ([a, b, c], [-d, -e, -f])
}

/// How far, in steps, `p` is outside of the intervals `lo` to `hi`.
#[inline(always)]
fn outside<L: Lanes>(l: L, lo: &[u8; LANES], hi: &[u8; LANES], p: L::F) -> L::F {
    l.max(l.max(l.sub(l.bytes(lo), p), l.sub(p, l.bytes(hi))), l.splat(0.0))
}

/// Queries in `f64` that do not use eight lanes.
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

    /// Lower bounds of the distances, in the tree's units, from a point to the children; infinite for empty
    /// slots.
    pub(crate) fn point_gaps(&self, q: DVec3) -> [f64; LANES] {
        if q.length() > FAR {
            return self.far_gaps(q);
        }
        let (at, step) = (self.vector(q) + self.column(3), self.step());
        let slack = slack(q.length(), 1.0);
        let mut gaps = [f64::INFINITY; LANES];
        for (lane, gap) in gaps.iter_mut().enumerate().take(usize::from(self.count)) {
            let (lo, hi) = self.steps(lane);
            let outside = (lo - at).max(at - hi).max(DVec3::ZERO);
            *gap = ((outside * step).length() - slack).max(0.0);
        }
        gaps
    }

    /// As [`Self::point_gaps`], for a point so far away that `f32` cannot distinguish the boxes: their
    /// distances along the directions to their centres.
    pub(crate) fn far_gaps(&self, q: DVec3) -> [f64; LANES] {
        let step = self.step();
        let mut gaps = [f64::INFINITY; LANES];
        for (lane, gap) in gaps.iter_mut().enumerate().take(usize::from(self.count)) {
            let (lo, hi) = self.steps(lane);
            let middle = (lo.midpoint(hi) - self.column(3)) * step * step;
            // Rows of the frame are axes over steps: their transpose leads back.
            let [x, y, z] = [self.column(0), self.column(1), self.column(2)].map(|c| c.dot(middle));
            let way = DVec3::new(x, y, z) - q;
            let distance = way.length();
            let extent = 0.5 * self.vector(way / distance).abs().dot((hi - lo) * step * step);
            *gap = (distance * (1.0 - 1e-15) - extent - slack(1.0, 1.0)).max(0.0);
        }
        gaps
    }

    /// For each child how far along a ray, in the tree's frame and units, its box begins; infinite
    /// where the ray misses it.
    pub(crate) fn entries(&self, ray: &Ray) -> [f64; LANES] {
        let (at, along) = (self.vector(ray.origin) + self.column(3), self.vector(ray.direction));
        let margin = slack(ray.origin.length(), 1.0) / self.step();
        let (mut enter, mut leave) = ([0.0_f64; LANES], [ray.longest; LANES]);
        for k in 0..3 {
            let inverse = along[k].recip();
            for lane in 0..LANES {
                let lo = f64::from(self.lo[k][lane]) - margin[k] - at[k];
                let hi = f64::from(self.hi[k][lane]) + margin[k] - at[k];
                if inverse.is_finite() {
                    let (a, b) = (lo * inverse, hi * inverse);
                    enter[lane] = enter[lane].max(a.min(b));
                    leave[lane] = leave[lane].min(a.max(b));
                } else if lo > 0.0 || hi < 0.0 {
                    leave[lane] = f64::NEG_INFINITY;
                }
            }
        }
        let count = usize::from(self.count);
        let is_met = |lane: usize| lane < count && enter[lane] <= leave[lane];
        std::array::from_fn(|lane| if is_met(lane) { enter[lane] } else { f64::INFINITY })
    }
}
