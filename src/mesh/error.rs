//! Errors of this module.

use crate::id::{FaceId, VertexId};

/// Most faces of a mesh: a [`crate::mesh::Halfedge`] packs its face with two bits for the side.
pub(crate) const MAX_FACES: usize = 1 << 30;

/// Why a list of triangles is not an oriented manifold mesh.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum MeshError {
    /// More vertices or faces than 32-bit numbers count.
    #[error("{vertices} vertices and {faces} faces are too many: at most {} and {} can be counted", u32::MAX - 1, MAX_FACES)]
    TooMany {
        /// How many vertices there are.
        vertices: usize,
        /// How many faces there are.
        faces: usize,
    },
    /// A corner names a vertex that does not exist.
    #[error("face {face} names vertex {vertex}, but there are {vertices} vertices")]
    CornerOutOfRange {
        /// The face.
        face: FaceId,
        /// The vertex it names.
        vertex: VertexId,
        /// How many vertices there are.
        vertices: usize,
    },
    /// A face uses one vertex twice.
    #[error("face {face} uses vertex {vertex} twice")]
    RepeatedCorner {
        /// The face.
        face: FaceId,
        /// The vertex used twice.
        vertex: VertexId,
    },
    /// A coordinate is NaN or infinite.
    #[error("vertex {vertex} has a coordinate that is not finite: {position:?}")]
    NotFinite {
        /// The vertex.
        vertex: VertexId,
        /// Its coordinates, in m.
        position: [f64; 3],
    },
    /// More than two faces meet at an edge, or two of them run along it in the same direction.
    #[error(
        "edge {from}-{to} is not manifold: faces {first} and {second} both run along it in this direction"
    )]
    NonManifoldEdge {
        /// Start of the directed edge.
        from: VertexId,
        /// End of the directed edge.
        to: VertexId,
        /// First face that has the directed edge.
        first: FaceId,
        /// Second face that has it.
        second: FaceId,
    },
    /// The faces at a vertex form more than one fan.
    #[error("vertex {vertex} is not manifold: its faces form {fans} fans, one is needed")]
    NonManifoldVertex {
        /// The vertex.
        vertex: VertexId,
        /// Number of fans of faces around it.
        fans: usize,
    },
    /// A vertex that no face uses.
    #[error("vertex {vertex} belongs to no face")]
    IsolatedVertex {
        /// The vertex.
        vertex: VertexId,
    },
}
