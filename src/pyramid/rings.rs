use crate::{
    id::{IdVec, VertexId},
    parallel::par_collect,
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
        let neighbours = par_collect(surface.degree.len(), |range, neighbours| {
            range.map(VertexId::new).for_each(|v| neighbours.extend(surface.ring(v)));
        });
        Self { starts, neighbours }
    }

    /// The neighbours of `v`, as [`Surface::ring`] gives them.
    #[inline]
    pub(super) fn of(&self, v: VertexId) -> &[VertexId] {
        &self.neighbours[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
    }

    /// `of` every vertex and its ring, in parallel.
    pub(super) fn map(&self, of: impl Fn(VertexId, &[VertexId]) -> f64 + Sync) -> IdVec<VertexId, f64> {
        let values = par_collect(self.starts.len() - 1, |range, values| {
            values.extend(range.map(VertexId::new).map(|v| of(v, self.of(v))));
        });
        values.into()
    }
}
