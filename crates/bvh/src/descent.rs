//! The traversal of all searches for nearest primitives: down to one packet, then wherever something nearer
//! may be.

use arrayvec::ArrayVec;

use crate::lanes::Lanes;
use crate::node8::{Child, Node8, Target};
use crate::tree::{DEPTH, STACK, Tree};

/// Handles the packets of a traversal.
pub(crate) trait Visitor<L: Lanes> {
    /// Compares the contents of a packet with `point`, in the tree's frame and units, and lowers the
    /// bound if it can: squares above it are ignored. Must be `#[inline(always)]`.
    fn visit(&mut self, l: L, point: [f32; 3], packet: usize, bound: &mut f32);
}

/// A traversal of a tree.
pub(crate) struct Descent<'a, L: Lanes> {
    pub(crate) l: L,
    pub(crate) tree: &'a Tree,
    pub(crate) point: [f32; 3],
    pub(crate) bound: f32,
    /// Boxes to be opened: squared distance and child in one number. Distances are not negative, so
    /// their bits sort as they do.
    stack: ArrayVec<u64, STACK>,
}

/// A squared distance and a number in one word, which sorts by the distance.
#[inline(always)]
pub(crate) fn entry(squared: f32, number: u32) -> u64 {
    u64::from(squared.to_bits()) << 32 | u64::from(number)
}

#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the halves of 64 bits")]
pub(crate) fn parts(entry: u64) -> (f32, u32) {
    (f32::from_bits((entry >> 32) as u32), entry as u32)
}

/// The bound that follows from a squared distance, if a computed distance is off by at most `slack`.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "the last factor is larger than the rounding")]
pub(crate) fn bound_of(squared: f32, slack: f64) -> f32 {
    let reach = squared.sqrt() + 2.0 * slack as f32;
    reach * reach * (1.0 + 8.0 * f32::EPSILON)
}

impl<'a, L: Lanes> Descent<'a, L> {
    #[inline(always)]
    pub(crate) fn new(l: L, tree: &'a Tree, point: [f32; 3], bound: f32) -> Self {
        Self { l, tree, point, bound, stack: ArrayVec::new() }
    }

    /// Visits every packet that may contain something within the bound; afterwards the bound is that of the
    /// nearest.
    #[inline(always)]
    pub(crate) fn run(&mut self, visitor: &mut impl Visitor<L>) {
        self.descend(visitor);
        self.drain(visitor);
    }

    /// As [`Self::run`], from a packet that may contain the nearest: it is visited first, then everything
    /// below its ancestors that may be nearer.
    ///
    /// No boxes have to be compared before the next packet is known, so this is faster than the descent if
    /// the packet does contain the nearest.
    #[inline(always)]
    pub(crate) fn climb(&mut self, packet: u32, visitor: &mut impl Visitor<L>) {
        let l = self.l;
        let tree = self.tree;
        visitor.visit(l, self.point, packet as usize, &mut self.bound);
        let (mut from, mut index) = (Child::packet(packet), tree.owners[packet as usize]);
        loop {
            let node = &tree.nodes[index as usize];
            let squared = node.distance_squared(l, self.point);
            let mask = l.le(squared, l.splat(self.bound)) & !node.lane_bit(from);
            if mask & node.used() != 0 {
                self.push(node, squared, mask);
                self.drain(visitor);
            }
            if Child(index) == Child::ROOT {
                return;
            }
            (from, index) = (Child(index), node.above);
        }
    }

    /// Follows the nearest box down to one packet, whose nearest triangle gives the first bound; then pushes
    /// the other children of the nodes on this path that are within that bound, the deepest on top.
    ///
    /// Without a bound the walk from the root would push every child of these nodes.
    #[inline(always)]
    fn descend(&mut self, visitor: &mut impl Visitor<L>) {
        let l = self.l;
        let tree = self.tree;
        let mut trail = ArrayVec::<_, DEPTH>::new();
        let mut at = Child::ROOT;
        while let Target::Node(index) = at.target() {
            let node = &tree.nodes[index];
            let squared = node.distance_squared(l, self.point);
            let lane = l.least(squared) & 7;
            trail.push((index, lane, squared));
            at = node.child(lane as usize);
        }
        if let Target::Packet(packet) = at.target() {
            visitor.visit(l, self.point, packet, &mut self.bound);
        }
        for &(index, taken, squared) in &trail {
            let mask = l.le(squared, l.splat(self.bound)) & !(1 << taken);
            if mask != 0 {
                self.push(&tree.nodes[index], squared, mask);
            }
        }
    }

    /// Opens all boxes within the bound, the nearest of a node first.
    #[inline(always)]
    fn drain(&mut self, visitor: &mut impl Visitor<L>) {
        let l = self.l;
        let tree = self.tree;
        while let Some(entry) = self.stack.pop() {
            let (squared, child) = parts(entry);
            if squared > self.bound {
                continue;
            }
            let mut at = Child(child);
            loop {
                let index = match at.target() {
                    Target::Packet(packet) => {
                        visitor.visit(l, self.point, packet, &mut self.bound);
                        break;
                    }
                    Target::Node(index) => index,
                };
                let node = &tree.nodes[index];
                let squared = node.distance_squared(l, self.point);
                let mask = l.le(squared, l.splat(self.bound)) & node.used();
                if mask == 0 {
                    break;
                }
                if mask & (mask - 1) == 0 {
                    // A single child need not go over the stack.
                    at = node.child(mask.trailing_zeros() as usize);
                    continue;
                }
                self.push(node, squared, mask);
                break;
            }
        }
    }

    /// Pushes the children of `node` in the lanes of `mask`, the nearest last.
    #[inline(always)]
    fn push(&mut self, node: &Node8, squared: L::F, mask: u32) {
        let squared = self.l.store(squared);
        let mut mask = mask & node.used();
        let first = self.stack.len();
        while mask != 0 {
            let lane = mask.trailing_zeros() as usize;
            mask &= mask - 1;
            let entry = entry(squared[lane & 7], node.child(lane).0);
            let mut slot = self.stack.len();
            self.stack.push(entry);
            while slot > first && self.stack[slot - 1] < entry {
                self.stack[slot] = self.stack[slot - 1];
                slot -= 1;
            }
            self.stack[slot] = entry;
        }
    }
}
