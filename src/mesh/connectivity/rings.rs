//! The neighbours of every vertex, one after the other in memory.

use crate::{
    id::{IdVec, VertexId},
    mesh::connectivity::boundary::loops_of,
    numeric::Csr,
    parallel::par_ids,
};

/// The one-rings of an oriented manifold that does not change, in the order of
/// [`crate::mesh::Adjacency`]. Several sweeps read them, and a walk from face to face would wait for
/// memory at each.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rings {
    neighbours: Csr<VertexId>,
    pub(crate) on_boundary: IdVec<VertexId, bool>,
}

impl Rings {
    /// Rings of these numbers of neighbours, which `fill` writes, in parallel.
    pub(super) fn fill(
        on_boundary: IdVec<VertexId, bool>,
        degrees: &IdVec<VertexId, u32>,
        fill: impl Fn(VertexId, &mut [VertexId]) + Sync,
    ) -> Self {
        let neighbours = Csr::filled(degrees, |row, ring| fill(VertexId::new(row), ring));
        Self { neighbours, on_boundary }
    }

    #[inline]
    pub(crate) fn of(&self, v: VertexId) -> &[VertexId] {
        &self.neighbours[v.index()]
    }

    /// Number of edges.
    pub(super) fn edges(&self) -> usize {
        self.neighbours.items().len() / 2
    }

    pub(crate) fn vertices(&self) -> usize {
        self.on_boundary.len()
    }

    /// `of` every vertex and its ring, in parallel.
    pub(crate) fn map(&self, of: impl Fn(VertexId, &[VertexId]) -> f64 + Sync) -> IdVec<VertexId, f64> {
        par_ids(self.vertices(), |v| of(v, self.of(v)))
    }

    /// The boundary loops, each from its smallest vertex, faces on the left; sorted by that vertex.
    pub(crate) fn boundary_loops(&self) -> Vec<Vec<VertexId>> {
        let on_boundary = self.on_boundary.enumerate().filter(|(_, is_on)| **is_on);
        loops_of(&on_boundary.map(|(v, _)| [v, self.of(v)[0]]).collect::<Vec<_>>())
    }
}
