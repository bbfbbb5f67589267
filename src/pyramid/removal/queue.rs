//! The vertices whose removal is worth a try, in a fixed order.

use rayon::prelude::*;

use crate::id::{IdVec, VertexId};
use crate::mesh::HalfedgeMesh;

/// Where a vertex stands that is to be removed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Standing {
    /// Kept, or removed already.
    Settled,
    Waiting,
    /// Refused; to be tried again when its star has changed.
    Parked,
}

/// A refused vertex comes back only when a neighbour has gone, so the work is proportional to what
/// is removed.
#[derive(Debug, Clone)]
pub(super) struct Queue<'a> {
    /// All vertices, and the place of each among them.
    order: &'a [VertexId],
    ranks: IdVec<VertexId, u32>,
    standing: IdVec<VertexId, Standing>,
    waiting: Vec<VertexId>,
    woken: Vec<VertexId>,
    /// The last round in which a vertex was chosen or next to a chosen one.
    blocked: IdVec<VertexId, u32>,
    /// The last round in which a neighbour of each vertex was removed.
    changed: IdVec<VertexId, u32>,
    /// The round at hand, from 1.
    pub(super) round: u32,
}

impl<'a> Queue<'a> {
    /// All vertices but the `kept` ones, in the order of `order`.
    pub(super) fn new(kept: &IdVec<VertexId, bool>, order: &'a [VertexId]) -> Self {
        let mut ranks = IdVec::filled(0, kept.len());
        for (rank, &v) in (0..).zip(order) {
            ranks[v] = rank;
        }
        Self {
            order,
            standing: kept.map(|&k| if k { Standing::Settled } else { Standing::Waiting }),
            ranks,
            waiting: order.iter().copied().filter(|&v| !kept[v]).collect(),
            woken: Vec::new(),
            blocked: IdVec::filled(0, kept.len()),
            changed: IdVec::filled(0, kept.len()),
            round: 0,
        }
    }

    /// Begins a round: waiting vertices of which no two are neighbours, sorted by id; empty when
    /// none waits.
    pub(super) fn independent(&mut self, surface: &HalfedgeMesh) -> Vec<VertexId> {
        self.waiting.append(&mut self.woken);
        // Small stars first: their fillings are nearly always fans, and rings stay small.
        let key = |&v: &VertexId| u64::from(surface.degree[v]) << 32 | u64::from(self.ranks[v]);
        let waits = |v: &&VertexId| self.standing[**v] == Standing::Waiting;
        let mut keys: Vec<u64> = self.waiting.iter().filter(waits).map(key).collect();
        keys.par_sort_unstable();
        // Who was refused and woken in the same round would be there twice.
        keys.dedup();
        #[expect(clippy::cast_possible_truncation, reason = "the lower half is the rank")]
        let ranks = keys.iter().map(|&key| key as u32 as usize);
        self.waiting.clear();
        self.waiting.extend(ranks.map(|rank| self.order[rank]));
        self.round += 1;
        let mut chosen = Vec::new();
        for &v in &self.waiting {
            if self.blocked[v] != self.round {
                chosen.push(v);
                for w in surface.ring(v) {
                    self.blocked[w] = self.round;
                }
            }
        }
        // Neighbours in memory are planned together.
        chosen.sort_unstable();
        chosen
    }

    /// `v` may not be removed as things are.
    pub(super) fn park(&mut self, v: VertexId) {
        self.standing[v] = Standing::Parked;
    }

    /// `v` is gone and its `ring` has changed.
    pub(super) fn removed(&mut self, v: VertexId, ring: &[VertexId]) {
        self.standing[v] = Standing::Settled;
        for &w in ring {
            self.changed[w] = self.round;
            self.wake(w);
        }
    }

    /// Whether the neighbours of `v` may be others than at the beginning of the round.
    pub(super) fn has_changed(&self, v: VertexId) -> bool {
        self.changed[v] == self.round
    }

    /// Marks all vertices for another try, after the limits are relaxed.
    pub(super) fn wake_all(&mut self) {
        for v in self.standing.ids() {
            self.wake(v);
        }
    }

    fn wake(&mut self, v: VertexId) {
        if self.standing[v] == Standing::Parked {
            self.standing[v] = Standing::Waiting;
            self.woken.push(v);
        }
    }
}
