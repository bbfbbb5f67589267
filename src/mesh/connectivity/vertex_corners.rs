//! The corners of faces around each vertex.

use crate::{
    id::{FaceId, VertexId},
    mesh::Halfedge,
    numeric::Csr,
};

/// The corners around each vertex, in the order of their faces, for any set of triangles, manifold
/// or not. A corner is named by the halfedge that leaves it.
#[derive(Debug, Clone)]
pub(crate) struct VertexCorners(Csr<Halfedge>);

impl VertexCorners {
    /// Lists the corners of the first `vertices` vertices; those of others are left out.
    pub(crate) fn new(triangles: impl Iterator<Item = [VertexId; 3]> + Clone, vertices: usize) -> Self {
        let corners = triangles.enumerate().flat_map(|(face, t)| {
            let face = FaceId::new(face);
            [0, 1, 2].map(|side| (t[side].index(), Halfedge::new(face, side)))
        });
        Self(Csr::from_pairs(vertices, corners.filter(move |&(v, _)| v < vertices)))
    }

    #[inline]
    pub(crate) fn of(&self, v: VertexId) -> &[Halfedge] {
        &self.0[v.index()]
    }

    /// The corners of all vertices, one vertex after the other.
    pub(crate) fn all(&self) -> &[Halfedge] {
        self.0.items()
    }

    /// The faces around `v`, smallest id first.
    #[inline]
    pub(crate) fn faces(&self, v: VertexId) -> impl Iterator<Item = FaceId> + Clone {
        self.of(v).iter().map(|h| h.face())
    }

    /// Where the corners of `v` are among those of all vertices.
    #[inline]
    pub(crate) fn range(&self, v: VertexId) -> std::ops::Range<usize> {
        self.0.range(v.index())
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
        assert_eq!(corners.all().len(), 9, "corners of other vertices are left out");
    }
}
