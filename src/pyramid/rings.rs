use rayon::prelude::*;

use crate::{
    id::{IdVec, VertexId},
    pyramid::surface::Surface,
};

/// The neighbours of every vertex of a surface at rest, one after the other in memory: several sweeps read them, and
/// a walk from face to face waits for each.
pub(super) struct Rings {
    /// Where each ring starts; one more entry than vertices.
    starts: Vec<u32>,
    neighbours: Vec<VertexId>,
}

impl Rings {
    pub(super) fn new(surface: &Surface) -> Self {
        let mut starts = Vec::with_capacity(surface.degree.len() + 1);
        let mut end = 0;
        starts.push(end);
        for degree in &surface.degree {
            end += degree;
            starts.push(end);
        }
        let vertices = (0..surface.degree.len()).into_par_iter().map(VertexId::new);
        Self { starts, neighbours: vertices.flat_map_iter(|v| surface.ring(v)).collect() }
    }

    /// The neighbours of `v`, as [`Surface::ring`] gives them.
    #[inline]
    pub(super) fn of(&self, v: VertexId) -> &[VertexId] {
        &self.neighbours[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
    }

    /// `of` every vertex and its ring, in parallel.
    pub(super) fn map(&self, of: impl Fn(VertexId, &[VertexId]) -> f64 + Sync) -> IdVec<VertexId, f64> {
        let vertices = (0..self.starts.len() - 1).into_par_iter().map(VertexId::new);
        vertices.map(|v| of(v, self.of(v))).collect::<Vec<_>>().into()
    }
}
