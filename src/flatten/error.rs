//! Why a mesh cannot be flattened.

use crate::{
    id::{FaceId, VertexId},
    mesh::MeshError,
    pyramid::PyramidError,
    sparse::SparseError,
};

/// Why a mesh cannot be flattened.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum FlattenError {
    /// The triangles are not an oriented manifold.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The mesh has no pyramid.
    #[error(transparent)]
    Pyramid(#[from] PyramidError),
    /// Closed, in several pieces, or with handles.
    #[error(
        "Euler characteristic {euler} with {loops} boundary loops in {components} components; a disk with holes is \
         needed: one component with at least one loop and Euler characteristic 2 - loops"
    )]
    NotADisk {
        /// Vertices minus edges plus faces.
        euler: i64,
        /// Boundary loops.
        loops: usize,
        /// Components.
        components: usize,
    },
    /// All corners of a face lie on one point.
    #[error("the corners of face {face} all lie on one point; a face needs an edge with a length")]
    PointFace {
        /// The face.
        face: FaceId,
    },
    /// The mesh is too large or too small for floating-point areas.
    #[error("the area of the mesh is {area} m^2; a positive finite one is needed")]
    Size {
        /// The area found, in m^2.
        area: f64,
    },
    /// An option out of range.
    #[error("option {name} is {found}; {needed}")]
    Option {
        /// Name of the field of [`crate::flatten::FlattenOptions`].
        name: &'static str,
        /// The value found.
        found: f64,
        /// What is needed.
        needed: &'static str,
    },
    /// A density that is not positive and finite.
    #[error("vertex {vertex} has density {found} taxels per m^2; a positive finite one is needed")]
    Density {
        /// The vertex of level 0.
        vertex: VertexId,
        /// The density found.
        found: f64,
    },
    /// Not one density per vertex.
    #[error("there are {found} densities; {needed} are needed, one per vertex of level 0")]
    Densities {
        /// Densities found.
        found: usize,
        /// Vertices.
        needed: usize,
    },
    /// No start without flips could be computed, not even with a convex boundary.
    #[error(
        "face {face} has no area left on the map inside a circle; the mesh is too long and thin there for 64-bit numbers, \
         remesh it or cut it into shorter pieces"
    )]
    NoStart {
        /// The first face without area on the map.
        face: FaceId,
    },
    /// A corner of the rectangle is not on the outer loop.
    #[error("vertex {vertex} cannot be a corner of the map: it is not on the outer boundary loop")]
    Corner {
        /// The vertex given.
        vertex: VertexId,
    },
    /// The outer loop has no four corners.
    #[error("the outer boundary loop of {found} vertices has no four different corners for a rectangle")]
    Corners {
        /// Vertices of the loop.
        found: usize,
    },
    /// A linear system could not be solved.
    #[error("the system of the {method} map cannot be solved: {source}")]
    System {
        /// Which map.
        method: &'static str,
        /// Why.
        source: SparseError,
    },
}
