//! Errors of this module.

use crate::{id::VertexId, mesh::MeshError, pyramid::LevelId, run::Cancelled, skin::TaxelError};

/// Why a patch has no pyramid, or data is not a valid pyramid.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
pub enum PyramidError {
    /// The triangles are not an oriented manifold.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// The run was cancelled.
    #[error(transparent)]
    Cancelled(#[from] Cancelled),
    /// An array that does not fit its mesh.
    #[error("{what} has {found} entries, {needed} are needed")]
    Length {
        /// Which array.
        what: &'static str,
        /// Entries found.
        found: usize,
        /// Entries needed.
        needed: usize,
    },
    /// A receptive area that is negative or not a number.
    #[error("vertex {vertex} has an area of {found} m^2; zero or more is needed")]
    Area {
        /// The vertex.
        vertex: VertexId,
        /// Its area, in m^2.
        found: f64,
    },
    /// Densities, weights or acuities out of range, or not one per vertex.
    #[error(transparent)]
    Taxels(#[from] TaxelError),
    /// A ratio that shrinks too little to make levels.
    #[error("a ratio of {found} between levels; at least {least} is needed")]
    Ratio {
        /// The requested ratio.
        found: f64,
        /// The least ratio.
        least: f64,
    },
    /// A pyramid without levels.
    #[error("a pyramid without levels; level 0, the skin itself, is needed")]
    NoLevels,
    /// A level that breaks a rule.
    #[error("level {level}: {source}")]
    AtLevel {
        /// The level.
        level: LevelId,
        /// The rule.
        source: Box<PyramidError>,
    },
    /// A prolongation for another number of coarse vertices than there are.
    #[error("{what} names {found} coarse vertices, but there are {needed}")]
    Columns {
        /// Which one: `from_coarser` or `to_finest`.
        what: &'static str,
        /// Coarse vertices it is made for.
        found: usize,
        /// Coarse vertices there are.
        needed: usize,
    },
    /// A prolongation with a bad row.
    #[error("{what}: {source}")]
    Rows {
        /// Which one: `from_coarser` or `to_finest`.
        what: &'static str,
        /// The rule.
        source: Box<PyramidError>,
    },
    /// A centre that is not a vertex of the level it should come from.
    #[error("vertex {vertex} names vertex {found} of {what}, which has {count}")]
    NotNested {
        /// The coarse vertex.
        vertex: VertexId,
        /// The level it should come from.
        what: &'static str,
        /// The vertex it names there.
        found: VertexId,
        /// Vertices of that level.
        count: usize,
    },
    /// A row of a prolongation that names a vertex which does not exist.
    #[error("row {row} names coarse vertex {found}, but there are {count}")]
    OutOfRange {
        /// The fine vertex.
        row: VertexId,
        /// The coarse vertex it names.
        found: VertexId,
        /// Number of coarse vertices.
        count: usize,
    },
    /// A row of a prolongation that is not a convex combination.
    #[error("row {row} has weights {weights:?}; they must be non-negative with sum 1")]
    Weights {
        /// The fine vertex.
        row: VertexId,
        /// Its weights.
        weights: [f64; 3],
    },
    /// A row of a prolongation that does not name a face of its level.
    #[error(
        "row {row} of to_finest has vertices {corners:?} with weights {weights:?}; the corners of one face with \
         non-negative weights are needed"
    )]
    NoFace {
        /// The row: a vertex of level 0.
        row: VertexId,
        /// The vertices it names.
        corners: [VertexId; 3],
        /// Their weights.
        weights: [f64; 3],
    },
}
