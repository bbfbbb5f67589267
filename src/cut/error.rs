//! Errors of this module.

use crate::{id::VertexId, mesh::MeshError, skin::TaxelId};

/// Why a surface cannot be cut as asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum CutError {
    /// The triangles are not an oriented manifold.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A seam through a taxel that is not there, or not the only one of its id.
    #[error("the seam names taxel {id}, but {found} taxels have that id; one is needed")]
    Taxel {
        /// The id.
        id: TaxelId,
        /// Taxels that have it.
        found: usize,
    },
    /// A seam between taxels that no edge joins.
    #[error("the seam goes from taxel {from} to taxel {to}, but no edge joins them")]
    NotAnEdge {
        /// One end.
        from: TaxelId,
        /// The other end.
        to: TaxelId,
    },
    /// A seam along a boundary.
    #[error("the seam goes from taxel {from} to taxel {to}, but that edge is on the boundary already")]
    OnBoundary {
        /// One end.
        from: TaxelId,
        /// The other end.
        to: TaxelId,
    },
    /// A seam that cuts the surface into pieces, or a surface that was in pieces before.
    #[error("the seam through vertex {vertex} leaves the surface in {components} pieces; one is needed")]
    Disconnects {
        /// The smallest vertex of the seam.
        vertex: VertexId,
        /// Pieces.
        components: usize,
    },
    /// An area ratio that no cut reaches, into this many charts at most.
    #[error(
        "the largest area ratio of the map is {found:.4} with the most charts that are tried, {charts}; {wanted} was asked for"
    )]
    AreaRatio {
        /// The ratio reached.
        found: f64,
        /// Charts that were tried at most.
        charts: usize,
        /// The ratio asked for.
        wanted: f64,
    },
    /// An area ratio that contradicts what the densities and acuities of taxels ask for.
    #[error(
        "the acuities or densities of the taxels ask for area ratios up to {asked:.3}, but {wanted} was asked for"
    )]
    AreasAsked {
        /// The largest ratio that taxels ask for.
        asked: f64,
        /// The ratio asked for.
        wanted: f64,
    },
    /// A surface that is not a disk with holes after the cut.
    #[error(
        "after the cut the surface has Euler characteristic {euler} and {loops} boundary loops; a disk with holes is \
         needed: at least one loop and Euler characteristic 2 - loops"
    )]
    NotADisk {
        /// Vertices minus edges plus faces.
        euler: i64,
        /// Boundary loops.
        loops: usize,
    },
}
