//! The neighbours of every vertex, one after the other in memory.

use crate::{
    id::{IdVec, VertexId},
    parallel::{par_ids, par_rows},
};

/// The one-rings of an oriented manifold that rests, in the order of [`crate::mesh::Adjacency`].
/// Several sweeps read them, and a walk from face to face waits for each.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rings {
    /// Where each ring starts; one more entry than vertices.
    pub(super) starts: Vec<u32>,
    pub(super) neighbours: Vec<VertexId>,
    pub(crate) on_boundary: IdVec<VertexId, bool>,
}

impl Rings {
    /// Rings of these numbers of neighbours, which `fill` writes, in parallel.
    pub(super) fn fill(
        on_boundary: IdVec<VertexId, bool>,
        degrees: &IdVec<VertexId, u32>,
        fill: impl Fn(VertexId, &mut [VertexId]) + Sync,
    ) -> Self {
        let mut starts = Vec::with_capacity(degrees.len() + 1);
        let mut end = 0_u32;
        starts.push(end);
        for &degree in degrees {
            end = end.checked_add(degree).expect("more than 2^32 neighbours");
            starts.push(end);
        }
        let neighbours = par_rows(&starts, |row, ring| fill(VertexId::new(row), ring));
        Self { starts, neighbours, on_boundary }
    }

    #[inline]
    pub(crate) fn of(&self, v: VertexId) -> &[VertexId] {
        &self.neighbours[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
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
        let mut seen = IdVec::<VertexId, bool>::filled(false, self.vertices());
        let mut loops = Vec::new();
        for v in self.on_boundary.ids() {
            if !self.on_boundary[v] || seen[v] {
                continue;
            }
            let mut walk = Vec::new();
            let mut at = v;
            while !seen[at] {
                seen[at] = true;
                walk.push(at);
                at = self.of(at)[0];
            }
            loops.push(walk);
        }
        loops
    }
}
