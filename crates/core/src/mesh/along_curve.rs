//! A mesh numbered along a space-filling curve: neighbours in space are near in memory, and results do not
//! depend on the order of a file.

use rayon::prelude::*;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Halfedge, TriMesh};
use crate::numeric::along_curve;
use crate::parallel::{par_ids, par_map};

/// A mesh whose vertices follow a Morton curve, and its faces their first corners.
#[derive(Debug)]
pub(crate) struct AlongCurve {
    pub(crate) mesh: TriMesh,
    /// For each vertex its id in the given mesh.
    vertices: IdVec<VertexId, VertexId>,
    /// The inverse: for each vertex of the given mesh its id here.
    pub(crate) numbers: IdVec<VertexId, VertexId>,
    /// For each face its first corner in the given mesh.
    corners: IdVec<FaceId, Halfedge>,
}

impl AlongCurve {
    /// Renumbers a valid mesh.
    pub(crate) fn new(mesh: &TriMesh) -> Self {
        let vertices: IdVec<VertexId, VertexId> =
            along_curve(mesh.positions.as_slice()).into_iter().map(VertexId::new).collect();
        let mut numbers = vertices.clone();
        vertices.enumerate().for_each(|(number, &v)| numbers[v] = number);
        let first = |face| {
            let corners = Halfedge::of_face(face);
            let keys = corners.map(|h| (numbers[h.start(mesh)], numbers[h.end(mesh)], h));
            keys[0].min(keys[1]).min(keys[2])
        };
        let mut firsts: Vec<_> = par_ids(mesh.triangles.len(), first).into();
        firsts.par_sort_unstable();
        let corners: IdVec<FaceId, Halfedge> = firsts.into_iter().map(|(_, _, h)| h).collect();
        let positions = par_map(vertices.as_slice(), |&v| mesh.positions[v]).into();
        let triangles = par_map(corners.as_slice(), |&h| around(h).map(|h| numbers[h.start(mesh)])).into();
        Self { mesh: TriMesh { positions, triangles }, vertices, numbers, corners }
    }

    /// The id of a vertex in the given mesh; unchanged if it is out of range.
    pub(crate) fn given(&self, v: VertexId) -> VertexId {
        self.vertices.get(v).copied().unwrap_or(v)
    }

    /// The corners of each face in the given mesh.
    pub(crate) fn given_corners(&self) -> impl Iterator<Item = [Halfedge; 3]> + '_ {
        self.corners.iter().map(|&h| around(h))
    }
}

fn around(h: Halfedge) -> [Halfedge; 3] {
    [h, h.next(), h.previous()]
}
