//! The corners of faces around each vertex.

use crate::{
    id::{FaceId, VertexId},
    mesh::Halfedge,
};

/// The corners around each vertex, in the order of their faces, for any set of triangles, manifold
/// or not. A corner is named by the halfedge that leaves it.
#[derive(Debug, Clone)]
pub(crate) struct VertexCorners {
    /// Where the corners of each vertex start; one more entry than vertices.
    starts: Vec<u32>,
    /// The corners of all vertices, one vertex after the other.
    pub(crate) corners: Vec<Halfedge>,
}

impl VertexCorners {
    /// Lists the corners of the first `vertices` vertices; those of others are left out.
    pub(crate) fn new(triangles: impl Iterator<Item = [VertexId; 3]> + Clone, vertices: usize) -> Self {
        let mut starts = vec![0_u32; vertices + 1];
        for v in triangles.clone().flatten().filter(|v| v.index() < vertices) {
            starts[v.index() + 1] += 1;
        }
        for i in 0..vertices {
            starts[i + 1] += starts[i];
        }
        let mut cursor = starts.clone();
        let mut corners = vec![Halfedge::NONE; starts[vertices] as usize];
        for (face, t) in triangles.enumerate() {
            for (side, v) in t.into_iter().enumerate().filter(|(_, v)| v.index() < vertices) {
                let at = &mut cursor[v.index()];
                corners[*at as usize] = Halfedge::new(FaceId::new(face), side);
                *at += 1;
            }
        }
        Self { starts, corners }
    }

    #[inline]
    pub(crate) fn of(&self, v: VertexId) -> &[Halfedge] {
        &self.corners[self.range(v)]
    }

    /// The faces around `v`, smallest id first.
    #[inline]
    pub(crate) fn faces(&self, v: VertexId) -> impl Iterator<Item = FaceId> + Clone {
        self.of(v).iter().map(|h| h.face())
    }

    /// Where the corners of `v` are in `corners`.
    #[inline]
    pub(crate) fn range(&self, v: VertexId) -> std::ops::Range<usize> {
        self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn every_corner_is_listed_at_its_vertex() {
        let mesh = shapes::fan(5);
        let corners = VertexCorners::new(mesh.triangles.iter().copied(), 3);
        for v in [0, 1, 2].map(VertexId::new) {
            assert!(corners.of(v).iter().all(|h| h.start(&mesh) == v), "corners of {v}");
            assert!(corners.faces(v).is_sorted(), "faces of {v}");
            assert_eq!(corners.of(v).len(), if v.index() == 0 { 5 } else { 2 });
        }
        assert_eq!(corners.corners.len(), 9, "corners of other vertices are left out");
    }
}
