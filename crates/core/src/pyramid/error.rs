//! Errors of this module.

use crate::{id::VertexId, mesh::MeshError, pyramid::LevelId, run::Cancelled, skin::TaxelError};

/// Why a patch has no pyramid, or data is not a valid pyramid.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum PyramidError {
    /// The triangles are not an oriented manifold.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// An array that does not fit its mesh.
    #[error("{what} has {found} entries, {needed} are needed")]
    Length { what: &'static str, found: usize, needed: usize },
    /// A receptive area that is negative or not a number.
    #[error("vertex {vertex} has an area of {found} m^2; zero or more is needed")]
    Area { vertex: VertexId, found: f64 },
    /// Densities, weights or acuities out of range, or not one per vertex.
    #[error(transparent)]
    Taxels(#[from] TaxelError),
    /// A ratio that shrinks too little to make levels.
    #[error("a ratio of {found} between levels; at least {least} is needed")]
    Ratio { found: f64, least: f64 },
    /// A pyramid without levels.
    #[error("a pyramid without levels; level 0, the skin itself, is needed")]
    NoLevels,
    /// A level that breaks a rule.
    #[error("level {level}: {source}")]
    AtLevel { level: LevelId, source: Box<PyramidError> },
    /// A prolongation for another number of coarse vertices than there are.
    #[error("{what} names {found} coarse vertices, but there are {needed}")]
    Columns { what: &'static str, found: usize, needed: usize },
    /// A prolongation with a bad row.
    #[error("{what}: {source}")]
    Rows { what: &'static str, source: Box<PyramidError> },
    /// A centre that is not a vertex of the level it should come from.
    #[error("vertex {vertex} names vertex {found} of {what}, which has {count}")]
    NotNested { vertex: VertexId, what: &'static str, found: VertexId, count: usize },
    /// A row of a prolongation that names a vertex which does not exist.
    #[error("row {row} names coarse vertex {found}, but there are {count}")]
    OutOfRange { row: VertexId, found: VertexId, count: usize },
    /// A row of a prolongation that is not a convex combination.
    #[error("row {row} has weights {weights:?}; they must be non-negative with sum 1")]
    Weights { row: VertexId, weights: [f64; 3] },
    /// A row of a prolongation that does not name a face of its level.
    #[error(
        "row {row} of to_finest has vertices {corners:?} with weights {weights:?}; the corners of one face with \
         non-negative weights are needed"
    )]
    NoFace { row: VertexId, corners: [VertexId; 3], weights: [f64; 3] },
}
