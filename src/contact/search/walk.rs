//! A walk over a tree, nearest box first, in `f64`: for the queries that need no eight lanes.

use arrayvec::ArrayVec;

use super::{
    lanes::LANES,
    node8::{Child, Node8, Target},
    tree::{STACK, Tree},
};

impl Tree {
    /// Visits every packet whose key is not above a bound, the least key first where it can.
    ///
    /// `keys` gives a lower bound for what is in each child of a node, infinite where nothing can
    /// be; `visit` handles a packet and returns the bound from then on. Nothing is allocated.
    pub(super) fn walk(
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
