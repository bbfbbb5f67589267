//! Errors of this module.

use crate::{id::VertexId, mesh::MeshError, skin::TaxelId};

/// Why a surface cannot be cut as asked.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what the fields are")]
pub enum CutError {
    /// The triangles are not an oriented manifold.
    #[error(transparent)]
    Mesh(#[from] MeshError),
    /// A seam through a taxel that is not there, or not the only one of its id.
    #[error("the seam names taxel {id}, but {found} taxels have that id; one is needed")]
    Taxel { id: TaxelId, found: usize },
    /// A seam between taxels that no edge joins.
    #[error("the seam goes from taxel {from} to taxel {to}, but no edge joins them")]
    NotAnEdge { from: TaxelId, to: TaxelId },
    /// A seam along a boundary.
    #[error("the seam goes from taxel {from} to taxel {to}, but that edge is on the boundary already")]
    OnBoundary { from: TaxelId, to: TaxelId },
    /// A seam that cuts the surface into pieces, or a surface that was in pieces before.
    #[error("the seam through vertex {vertex} leaves the surface in {components} pieces; one is needed")]
    Disconnects {
        /// The smallest vertex of the seam.
        vertex: VertexId,
        components: usize,
    },
    /// A surface that is not a disk with holes after the cut.
    #[error(
        "after the cut the surface has Euler characteristic {euler} and {loops} boundary loops; a disk with holes is \
         needed: at least one loop and Euler characteristic 2 - loops"
    )]
    NotADisk { euler: i64, loops: usize },
}
