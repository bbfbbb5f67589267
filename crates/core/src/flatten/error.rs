//! Why a mesh cannot be flattened.

use crate::id::{FaceId, VertexId};
use crate::mesh::MeshError;
use crate::pyramid::PyramidError;
use crate::run::Cancelled;
use crate::skin::{TaxelError, TaxelId};
use crate::sparse::SparseError;

/// Why a mesh cannot be flattened.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum FlattenError {
    /// The triangles are not an oriented manifold.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// The mesh has no pyramid.
    #[error(transparent)]
    Pyramid(PyramidError),
    /// Closed, in several pieces, or with handles.
    #[error(
        "Euler characteristic {euler} with {loops} boundary loops in {components} components; a disk with holes is \
         needed: one component with at least one loop and Euler characteristic 2 - loops"
    )]
    NotADisk { euler: i64, loops: usize, components: usize },
    /// All corners of a face coincide.
    #[error("the corners of face {face} all lie on one point; a face needs an edge with a length")]
    PointFace { face: FaceId },
    /// The mesh is too large or too small for floating-point areas, or its faces are nearly all degenerate.
    #[error(
        "the area of the mesh is {area} m^2; a finite one that is not lost in the rounding of the lengths of its \
         edges is needed"
    )]
    Size { area: f64 },
    /// An option out of range.
    #[error("option {name} is {found}; {needed}")]
    Option { name: &'static str, found: f64, needed: &'static str },
    /// A density that is not positive and finite.
    #[error("vertex {vertex} has density {found} taxels per m^2; a positive finite one is needed")]
    Density { vertex: VertexId, found: f64 },
    /// Densities, weights or acuities out of range, or not one per vertex of level 0.
    #[error(transparent)]
    Taxels(#[from] TaxelError),
    /// No start without flips could be computed, not even with a convex boundary.
    #[error(
        "face {face} has no area left on the map inside a circle; the mesh is too long and thin there for 64-bit numbers, \
         remesh it or cut it into shorter pieces"
    )]
    NoStart { face: FaceId },
    /// A given boundary with positions for other vertices than those of the outer loop.
    #[error(
        "vertex {vertex} has a position on the given boundary, or lacks one: exactly the vertices of the outer boundary \
         loop need a finite position"
    )]
    BoundaryPlace { vertex: VertexId },
    /// A taxel of a given boundary that does not exist, is not the only one with its id, or has two positions.
    #[error(
        "{taxels} taxels have the id {id}, with {places} positions on the given boundary; one of both is needed"
    )]
    BoundaryTaxel { id: TaxelId, taxels: usize, places: usize },
    /// A given boundary that is not a polygon around the map.
    #[error(
        "the given boundary crosses or touches itself {crossings} times and encloses {area} m^2; it must not cross itself \
         and run counter-clockwise, which makes the area positive"
    )]
    BoundaryShape { crossings: usize, area: f64 },
    /// No map was found that has no flip, keeps its holes and, if required, is one to one.
    #[error(
        "the best map found has {flips} flipped faces and overlaps itself at {overlaps} places; a map without any is \
         needed"
    )]
    NotInjective { flips: usize, overlaps: usize },
    /// No map without flips was found within the given boundary.
    #[error(
        "face {face} has no area within the given boundary; an edge between two positions on one straight side leaves none"
    )]
    NoRoom { face: FaceId },
    /// A linear system could not be solved.
    #[error("the system of the {method} map cannot be solved: {source}")]
    System { method: &'static str, source: SparseError },
}

impl From<PyramidError> for FlattenError {
    fn from(error: PyramidError) -> Self {
        match error {
            PyramidError::Cancelled(cancelled) => Self::Cancelled(cancelled),
            error => Self::Pyramid(error),
        }
    }
}
