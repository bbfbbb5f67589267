//! A walk over a tree, nearest box first, in `f64`: for the queries that need no eight lanes.

use glam::DVec3;

use super::{
    bvh8::{Bvh8, Child, Node8, Target},
    lanes::LANES,
    triangle8::Triangle8,
};
use crate::contact::geometry::Ray;

/// Entries of a stack that need no allocation: enough for trees of some ten million triangles.
const SHALLOW: usize = 96;

/// Boxes are compared in `f64` with a margin of this many times the size of the coordinates: some
/// hundred roundings.
const MARGIN: f64 = 1e-14;

/// A stack that allocates only for trees of unusual depth.
pub(super) struct Stack<T> {
    shallow: [T; SHALLOW],
    len: usize,
    deep: Vec<T>,
}

impl<T: Copy> Stack<T> {
    pub(super) fn new(filler: T) -> Self {
        Self { shallow: [filler; SHALLOW], len: 0, deep: Vec::new() }
    }

    pub(super) fn push(&mut self, entry: T) {
        if self.len < SHALLOW {
            self.shallow[self.len] = entry;
            self.len += 1;
        } else {
            self.deep.push(entry);
        }
    }

    pub(super) fn pop(&mut self) -> Option<T> {
        self.deep.pop().or_else(|| {
            self.len = self.len.checked_sub(1)?;
            Some(self.shallow[self.len])
        })
    }
}

impl Bvh8 {
    /// Visits every packet whose key is not above a bound, the least key first where it can.
    ///
    /// `keys` gives a lower bound for what is in each child of a node, infinite where nothing can
    /// be; `visit` handles a packet and returns the bound from then on.
    pub(super) fn walk(
        &self,
        mut bound: f64,
        keys: impl Fn(&Node8) -> [f64; LANES],
        mut visit: impl FnMut(&Triangle8) -> f64,
    ) {
        let mut stack = Stack::new((0.0, Child::ROOT));
        stack.push((0.0, Child::ROOT));
        while let Some((key, at)) = stack.pop() {
            if key > bound {
                continue;
            }
            match at.target() {
                Target::Packet(packet) => bound = visit(&self.packets[packet]),
                Target::Node(index) => {
                    let node = &self.nodes[index];
                    let mut near: [(f64, Child); LANES] = [(f64::INFINITY, at); LANES];
                    let keys = keys(node);
                    let mut count = 0;
                    for (key, child) in keys.into_iter().zip(node.children) {
                        // An empty slot is at infinity, where no bound is.
                        if key <= bound && key < f64::INFINITY {
                            near[count] = (key, child);
                            count += 1;
                        }
                    }
                    near[..count].sort_unstable_by(|a, b| b.0.total_cmp(&a.0));
                    near[..count].iter().for_each(|&entry| stack.push(entry));
                }
            }
        }
    }
}

impl Node8 {
    /// For each child a distance, in the tree's units, that nothing of it is nearer to the core of a
    /// volume; infinite for empty slots. `centre` and `extent` are those of the volume's core, in
    /// the tree's frame and units.
    pub(super) fn gaps(&self, centre: DVec3, extent: DVec3) -> [f64; LANES] {
        let margin = MARGIN * (1.0 + centre.length() + extent.length());
        std::array::from_fn(|lane| {
            let (lo, hi) = self.bounds(lane);
            let gap = (lo - centre).max(centre - hi) - extent;
            (gap.max(DVec3::ZERO).length() - margin).max(0.0)
        })
    }

    /// For each child how far along a ray, in the tree's frame and units, its box begins; infinite
    /// where the ray misses it.
    pub(super) fn entries(&self, ray: &Ray) -> [f64; LANES] {
        let margin = MARGIN * (1.0 + ray.origin.length());
        std::array::from_fn(|lane| {
            let (lo, hi) = self.bounds(lane);
            let (mut enter, mut leave) = (0.0_f64, ray.longest);
            for axis in 0..3 {
                let (lo, hi) = (lo[axis] - margin - ray.origin[axis], hi[axis] + margin - ray.origin[axis]);
                let d = ray.direction[axis];
                if d == 0.0 {
                    if lo > 0.0 || hi < 0.0 {
                        return f64::INFINITY;
                    }
                } else {
                    let (a, b) = (lo / d, hi / d);
                    (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
                }
            }
            // Some roundings of the quotients.
            if enter <= leave * (1.0 + MARGIN) && lo.x.is_finite() {
                enter * (1.0 - MARGIN)
            } else {
                f64::INFINITY
            }
        })
    }
}
