use crate::id::{Id, IdVec};

/// Union-find over things with two sides, faces or normals: it also knows whether two joined things lie the same way.
#[derive(Debug)]
pub(super) struct Sides<I> {
    /// An earlier member of the same set (or itself), and whether this one lies against it.
    parent: IdVec<I, (I, bool)>,
}

impl<I: Id> Sides<I> {
    /// `count` sets of one.
    pub(super) fn new(count: usize) -> Self {
        Self { parent: (0..count).map(|k| (I::new(k), false)).collect() }
    }

    /// Joins the sets of `a` and `b`; false if they are one already and disagree.
    pub(super) fn join(&mut self, a: I, b: I, against: bool) -> bool {
        let ((root_a, side_a), (root_b, side_b)) = (self.root(a), self.root(b));
        let roots_against = side_a ^ side_b ^ against;
        if root_a == root_b {
            return !roots_against;
        }
        self.parent[root_a.max(root_b)] = (root_a.min(root_b), roots_against);
        true
    }

    /// The first member of the set, and whether `member` lies against it; halves the path on the way.
    pub(super) fn root(&mut self, mut member: I) -> (I, bool) {
        let mut against = false;
        loop {
            let (up, side) = self.parent[member];
            let (top, top_side) = self.parent[up];
            if top == up {
                return (up, against ^ side);
            }
            self.parent[member] = (top, side ^ top_side);
            against ^= side ^ top_side;
            member = top;
        }
    }
}
