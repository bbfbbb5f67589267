//! Disjoint sets: union-find `(tarjan1975)` with path halving, and optionally with parity.

use crate::id::{Id, IdVec};

/// The relation that a [`DisjointSets`] stores between two members of one set: none (`()`), or a
/// [`Relation`].
pub(crate) trait Parity: Copy + Default {
    /// The relation of `a` and `c`, if `self` is that of `a` and `b` and `next` that of `b` and
    /// `c`.
    fn then(self, next: Self) -> Self;
}

impl Parity for () {
    #[inline]
    fn then(self, (): Self) -> Self {}
}

/// Whether two things with two sides, such as faces or normals, have the same orientation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) enum Relation {
    /// Both have the same orientation.
    #[default]
    Same,
    /// One is the other reversed.
    Reversed,
}

impl Relation {
    /// [`Self::Reversed`] if `is_reversed`.
    pub(crate) const fn reversed_if(is_reversed: bool) -> Self {
        if is_reversed { Self::Reversed } else { Self::Same }
    }

    pub(crate) fn is_reversed(self) -> bool {
        self == Self::Reversed
    }
}

impl Parity for Relation {
    #[inline]
    fn then(self, next: Self) -> Self {
        Self::reversed_if(self != next)
    }
}

/// Which set each thing is in; sets are numbered in the order of their smallest members.
#[derive(Debug, Clone)]
pub(crate) struct Labels<I> {
    /// The number of the set of each.
    pub(crate) of: IdVec<I, usize>,
    pub(crate) count: usize,
}

impl<I: Id> Labels<I> {
    /// The smallest member of each set.
    pub(crate) fn firsts(&self) -> Vec<I> {
        let mut firsts = Vec::with_capacity(self.count);
        for (member, &label) in self.of.enumerate() {
            if label == firsts.len() {
                firsts.push(member);
            }
        }
        firsts
    }
}

/// Disjoint sets of `I`; each is named by its root, its smallest member.
///
/// The roots do not depend on the order of joins. Without parity a member takes as much memory as
/// its id.
#[derive(Debug, Clone, Default)]
pub(crate) struct DisjointSets<I, P = ()> {
    /// A smaller member of the same set, or itself, and the relation to it.
    parents: IdVec<I, (I, P)>,
}

impl<I: Id, P: Parity> DisjointSets<I, P> {
    /// `count` sets of one member each.
    pub(crate) fn new(count: usize) -> Self {
        Self { parents: (0..count).map(|k| (I::new(k), P::default())).collect() }
    }

    /// The root of the set of `member` and the relation to it; halves the path it follows.
    fn find(&mut self, mut member: I) -> (I, P) {
        let mut relation = P::default();
        loop {
            let (parent, step) = self.parents[member];
            let (grandparent, next) = self.parents[parent];
            if grandparent == parent {
                return (parent, relation.then(step));
            }
            let both = step.then(next);
            self.parents[member] = (grandparent, both);
            relation = relation.then(both);
            member = grandparent;
        }
    }

    pub(crate) fn labels(&mut self) -> Labels<I> {
        let (mut of, mut count) = (IdVec::<I, usize>::default(), 0);
        for member in (0..self.parents.len()).map(I::new) {
            // The root is the smallest member, so it has its number already.
            let root = self.find(member).0;
            of.push(if root == member { count } else { of[root] });
            count += usize::from(root == member);
        }
        Labels { of, count }
    }
}

impl<I: Id> DisjointSets<I> {
    pub(crate) fn push(&mut self) -> I {
        self.parents.push((I::new(self.parents.len()), ()))
    }

    /// Removes all members; keeps the memory.
    pub(crate) fn clear(&mut self) {
        self.parents.clear();
    }

    #[inline]
    pub(crate) fn join(&mut self, a: I, b: I) {
        let (a, b) = (self.root(a), self.root(b));
        self.parents[a.max(b)] = (a.min(b), ());
    }

    /// The smallest member of the set of `member`.
    #[inline]
    pub(crate) fn root(&mut self, member: I) -> I {
        self.find(member).0
    }
}

impl<I: Id> DisjointSets<I, Relation> {
    /// Joins the sets of `a` and `b`; `false` if they are in one set already with another relation.
    #[inline]
    pub(crate) fn join(&mut self, a: I, b: I, relation: Relation) -> bool {
        let ((root_a, to_a), (root_b, to_b)) = (self.root(a), self.root(b));
        let roots = to_a.then(relation).then(to_b);
        if root_a == root_b {
            return roots == Relation::Same;
        }
        self.parents[root_a.max(root_b)] = (root_a.min(root_b), roots);
        true
    }

    /// The smallest member of the set of `member`, and the parity between them.
    #[inline]
    pub(crate) fn root(&mut self, member: I) -> (I, Relation) {
        self.find(member)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::id::VertexId;

    #[test]
    fn a_set_is_named_by_its_smallest_member() {
        let v = VertexId::new;
        let mut sets = DisjointSets::<VertexId>::new(6);
        for (a, b) in [(5, 4), (4, 2), (1, 0)] {
            sets.join(v(a), v(b));
        }
        let roots: Vec<_> = (0..6).map(|k| sets.root(v(k)).index()).collect();
        assert_eq!(roots, [0, 0, 2, 3, 2, 2]);
        let labels = sets.labels();
        assert_eq!((labels.of.as_slice(), labels.count), (&[0, 0, 1, 2, 1, 1][..], 3));
        assert_eq!(labels.firsts(), [0, 2, 3].map(v));
    }

    #[test]
    fn members_are_added_one_by_one() {
        let mut sets = DisjointSets::<VertexId>::default();
        let (a, b) = (sets.push(), sets.push());
        sets.join(a, b);
        assert_eq!(sets.root(b), a);
        sets.clear();
        assert_eq!(sets.push(), a, "from the first again");
        assert_eq!(sets.root(a), a, "alone");
    }

    #[test]
    fn sets_without_parity_take_four_bytes_a_member() {
        assert_eq!(size_of::<(VertexId, ())>(), 4);
    }

    /// A band of three faces is consistent, a Moebius band is not.
    #[test]
    fn a_contradiction_is_reported() {
        let v = VertexId::new;
        let mut sets = DisjointSets::<VertexId, Relation>::new(4);
        assert!(sets.join(v(0), v(1), Relation::Reversed));
        assert!(sets.join(v(1), v(2), Relation::Reversed));
        assert!(sets.join(v(0), v(2), Relation::Same), "reversed twice");
        assert!(!sets.join(v(2), v(0), Relation::Reversed));
        assert_eq!(sets.root(v(1)), (v(0), Relation::Reversed));
        assert_eq!(sets.root(v(3)), (v(3), Relation::Same), "alone");
    }

    /// Whatever the order of joins, the relation of two members is that of the path between them.
    #[test]
    fn relations_survive_the_halving_of_paths() {
        let v = VertexId::new;
        let is_reversed = |k: usize| k * k % 7 < 3;
        let mut sets = DisjointSets::<VertexId, Relation>::new(100);
        for k in (0..99).rev() {
            sets.join(v(k), v(k + 1), Relation::reversed_if(is_reversed(k) != is_reversed(k + 1)));
        }
        for k in 0..100 {
            let expected = Relation::reversed_if(is_reversed(k) != is_reversed(0));
            assert_eq!(sets.root(v(k)), (v(0), expected), "member {k}");
        }
    }
}
