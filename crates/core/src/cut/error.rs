//! Errors of this module.

use crate::{id::VertexId, mesh::MeshError, skin::TaxelId};

/// Why a surface cannot be cut as requested.
#[derive(Debug, Clone, PartialEq, thiserror::Error, strum::IntoStaticStr)]
#[strum(serialize_all = "snake_case")]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages explain the fields")]
pub enum CutError {
    #[error(transparent)]
    Mesh(#[from] MeshError),
    #[error("the area ratio to keep is {found}; a finite one above 1 is needed")]
    AreaRatio { found: f64 },
    #[error("the seam names taxel {id}, but {found} taxels have that id; one is needed")]
    Taxel { id: TaxelId, found: usize },
    #[error("the seam goes from taxel {from} to taxel {to}, but no edge joins them")]
    NotAnEdge { from: TaxelId, to: TaxelId },
    #[error("the seam goes from taxel {from} to taxel {to}, but that edge is on the boundary already")]
    OnBoundary { from: TaxelId, to: TaxelId },
    #[error("the seam through vertex {vertex} leaves the surface in {components} pieces; one is needed")]
    Disconnects {
        /// The smallest vertex of the seam.
        vertex: VertexId,
        components: usize,
    },
    #[error(
        "after the cut the surface has Euler characteristic {euler} and {loops} boundary loops; a disk with holes is \
         needed: at least one loop and Euler characteristic 2 - loops"
    )]
    NotADisk { euler: i64, loops: usize },
}
