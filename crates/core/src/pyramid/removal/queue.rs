//! The vertices that may be removed, in a fixed order.

use rayon::prelude::*;

use crate::id::{IdVec, VertexId};
use crate::mesh::HalfedgeMesh;
use crate::parallel::par_collect;

/// The state of a vertex in the queue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Standing {
    /// Kept, or removed already.
    Settled,
    Waiting,
    /// Refused; to be tried again when its star has changed.
    Parked,
}

/// A refused vertex is tried again only after a neighbour was removed, so the work is proportional to the
/// number of removals.
#[derive(Debug, Clone)]
pub(super) struct Queue {
    /// The rank of each vertex in the order that decides between neighbours.
    ranks: IdVec<VertexId, u32>,
    standing: IdVec<VertexId, Standing>,
    waiting: Vec<VertexId>,
    woken: Vec<VertexId>,
    /// The last round in which a neighbour of each vertex was removed.
    changed: IdVec<VertexId, u32>,
    /// The current round, from 1.
    pub(super) round: u32,
}

impl Queue {
    /// All vertices but the `kept` ones; `order` decides between neighbours.
    pub(super) fn new(kept: &IdVec<VertexId, bool>, order: &[VertexId]) -> Self {
        let mut ranks = IdVec::filled(0, kept.len());
        for (rank, &v) in (0..).zip(order) {
            ranks[v] = rank;
        }
        Self {
            standing: kept.map(|&k| if k { Standing::Settled } else { Standing::Waiting }),
            ranks,
            waiting: kept.ids().filter(|&v| !kept[v]).collect(),
            woken: Vec::new(),
            changed: IdVec::filled(0, kept.len()),
            round: 0,
        }
    }

    /// Begins a round: the waiting vertices that come before their waiting neighbours, sorted by id; empty
    /// when none waits.
    pub(super) fn independent(&mut self, surface: &HalfedgeMesh) -> Vec<VertexId> {
        self.round += 1;
        self.waiting.append(&mut self.woken);
        let waits = |v: VertexId| self.standing[v] == Standing::Waiting;
        self.waiting.retain(|&v| waits(v));
        // So that neighbours in memory are planned together.
        self.waiting.par_sort_unstable();
        // A vertex that was refused and woken in one round is listed twice.
        self.waiting.dedup();
        // Small stars first: their fillings are nearly always fans, and rings stay small.
        let key = |v: VertexId| (surface.degree[v], self.ranks[v]);
        let comes_first = |&v: &VertexId| surface.ring(v).all(|w| !waits(w) || key(v) < key(w));
        let waiting = &self.waiting;
        par_collect(waiting.len(), |range, chosen| {
            chosen.extend(waiting[range].iter().copied().filter(comes_first));
        })
    }

    /// Parks `v`, which cannot be removed now.
    pub(super) fn park(&mut self, v: VertexId) {
        self.standing[v] = Standing::Parked;
    }

    /// Records that `v` was removed and its `ring` has changed.
    pub(super) fn removed(&mut self, v: VertexId, ring: &[VertexId]) {
        self.standing[v] = Standing::Settled;
        for &w in ring {
            self.changed[w] = self.round;
            self.wake(w);
        }
    }

    /// Whether the neighbours of `v` may have changed since the round began.
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
