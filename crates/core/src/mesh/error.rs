//! Errors of this module.

use glam::DVec3;

use crate::id::{FaceId, VertexId};

/// Most faces of a mesh: a [`crate::mesh::Halfedge`] packs its face with two bits for the side.
pub(crate) const MAX_FACES: usize = 1 << 30;

/// Largest coordinate of a skin, a pose, a contact or a map, in m.
#[doc(hidden)]
pub const FARTHEST: f64 = 1e12;

/// Whether coordinates are finite and at most [`FARTHEST`].
#[inline]
pub(crate) fn is_within_reach(p: DVec3) -> bool {
    // The largest one may pass over NaN.
    p.is_finite() && p.abs().max_element() <= FARTHEST
}

/// The error of more vertices or faces than can be counted.
pub(crate) fn too_many(vertices: usize, faces: usize) -> Option<MeshError> {
    (vertices >= u32::MAX as usize || faces > MAX_FACES).then_some(MeshError::TooMany { vertices, faces })
}

/// Why a list of triangles is not an oriented manifold mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum MeshError {
    #[error("{vertices} vertices and {faces} faces are too many: at most {} and {} can be counted", u32::MAX - 1, MAX_FACES)]
    TooMany { vertices: usize, faces: usize },
    #[error("face {face} names vertex {vertex}, but there are {vertices} vertices")]
    CornerOutOfRange { face: FaceId, vertex: VertexId, vertices: usize },
    #[error("face {face} uses vertex {vertex} twice")]
    RepeatedCorner { face: FaceId, vertex: VertexId },
    #[error("vertex {vertex} is at {position:?}; finite coordinates within 1e12 m are needed")]
    NotFinite { vertex: VertexId, position: [f64; 3] },
    /// More than two faces meet at an edge, or two of them run along it in the same direction.
    #[error(
        "edge {from}-{to} is not manifold: faces {first} and {second} both run along it in this direction"
    )]
    NonManifoldEdge { from: VertexId, to: VertexId, first: FaceId, second: FaceId },
    #[error("vertex {vertex} is not manifold: its faces form {fans} fans, one is needed")]
    NonManifoldVertex { vertex: VertexId, fans: usize },
    #[error("vertex {vertex} belongs to no face")]
    IsolatedVertex { vertex: VertexId },
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{id::FaceId, mesh::Halfedge};

    #[test]
    fn faces_that_are_accepted_have_halfedges() {
        assert_eq!(too_many(3, MAX_FACES), None);
        assert!(too_many(3, MAX_FACES + 1).is_some(), "below the number that 32 bits count");
        assert_eq!(Halfedge::new(FaceId::new(MAX_FACES - 1), 2).face(), FaceId::new(MAX_FACES - 1));
    }
}
