//! Seams that a user gives, as pairs of taxels.

use std::collections::HashMap;

use crate::cut::seam_graph::{EdgeId, SeamEdges, SeamGraph};
use crate::cut::{CutError, CutMesh};
use crate::id::{Id, IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::skin::{PatchId, TaxelId, Taxels};

/// The vertices that pairs of taxels are, patch by patch.
/// Fails if a taxel is not there or not the only one of its id, or a pair is in two patches.
#[doc(hidden)]
pub fn pairs_by_patch<'a>(
    pairs: &[[TaxelId; 2]],
    patches: impl Iterator<Item = &'a Taxels>,
) -> Result<IdVec<PatchId, Vec<[VertexId; 2]>>, CutError> {
    let mut places: HashMap<TaxelId, Vec<(PatchId, VertexId)>> =
        pairs.iter().flatten().map(|&id| (id, Vec::new())).collect();
    let mut found = IdVec::default();
    for taxels in patches {
        let patch = found.push(Vec::new());
        for (vertex, id) in taxels.ids.enumerate() {
            if let Some(at) = places.get_mut(id) {
                at.push((patch, vertex));
            }
        }
    }
    let place = |id: TaxelId| match places.get(&id).map(Vec::as_slice) {
        Some(&[at]) => Ok(at),
        several => Err(CutError::Taxel { id, found: several.map_or(0, <[_]>::len) }),
    };
    for &[from, to] in pairs {
        let ((patch, a), (other, b)) = (place(from)?, place(to)?);
        if patch != other {
            return Err(CutError::NotAnEdge { from, to });
        }
        found[patch].push([a, b]);
    }
    Ok(found)
}

/// Cuts a mesh along edges; `ids` are those of its taxels, to name them.
/// Fails if the mesh is not an oriented manifold, a pair is not an edge or one of the boundary, or the mesh
/// is not one disk with holes after the cut.
#[doc(hidden)]
pub fn cut_along(
    mesh: &TriMesh,
    edges: &[[VertexId; 2]],
    ids: &IdVec<VertexId, TaxelId>,
) -> Result<CutMesh, CutError> {
    let graph = SeamGraph::new(mesh, None)?;
    let mut seam = SeamEdges::new();
    for &[a, b] in edges {
        let [from, to] = [ids[a], ids[b]];
        let found = graph.ends.as_slice().binary_search(&[a.min(b), a.max(b)]);
        let edge = found.map(EdgeId::new).map_err(|_| CutError::NotAnEdge { from, to })?;
        if graph.is_free(edge) {
            return Err(CutError::OnBoundary { from, to });
        }
        seam.insert(edge);
    }
    graph.checked(&seam)
}
