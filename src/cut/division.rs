//! Faces of a patch in charts of their own, each with a cut of its own.

use std::collections::BTreeMap;

use glam::DVec3;

use crate::{
    cut::{CutError, CutMesh},
    id::{FaceId, IdVec, VertexId},
    mesh::{Adjacency, Halfedge, TriMesh},
    numeric::{DisjointSets, order_by},
};

/// A chart of a patch.
#[derive(Debug, Clone)]
pub(crate) struct Chart {
    /// Its faces, ascending.
    pub(crate) faces: Vec<FaceId>,
    /// How it is cut open further, if it is: the cut of the mesh of its faces.
    pub(crate) cut: Option<CutMesh>,
}

/// A patch that is divided.
pub(crate) struct Division<'m> {
    mesh: &'m TriMesh,
    adjacency: Adjacency,
}

impl<'m> Division<'m> {
    /// # Errors
    /// If the mesh is not an oriented manifold.
    pub(crate) fn new(mesh: &'m TriMesh) -> Result<Self, CutError> {
        Ok(Self { mesh, adjacency: Adjacency::new(mesh)? })
    }

    /// All faces.
    pub(crate) fn faces(&self) -> Vec<FaceId> {
        self.mesh.triangles.ids().collect()
    }

    /// The faces as a mesh of their own, and the vertices of the patch that its vertices are. Faces
    /// that meet in a vertex alone do not hang together there.
    pub(crate) fn mesh_of(&self, faces: &[FaceId]) -> (TriMesh, IdVec<VertexId, VertexId>) {
        let local = self.places(std::iter::once(faces));
        let mut number = IdVec::<VertexId, Option<VertexId>>::filled(None, self.mesh.positions.len());
        let mut vertices = IdVec::<VertexId, VertexId>::default();
        let mut named = |v: VertexId| *number[v].get_or_insert_with(|| vertices.push(v));
        let triangles: IdVec<FaceId, [VertexId; 3]> =
            faces.iter().map(|&face| self.mesh.triangles[face].map(&mut named)).collect();
        let across = |h: Halfedge| {
            let twin = self.adjacency.twin(Halfedge::new(faces[h.face().index()], h.side()))?;
            let (_, face) = local[twin.face()]?;
            Some(Halfedge::new(face, twin.side()))
        };
        let apart = CutMesh::new(&triangles, vertices.len(), across);
        let positions: IdVec<VertexId, DVec3> = vertices.map(|&v| self.mesh.positions[v]);
        (apart.mesh(&positions), apart.unsplit.map(|&v| vertices[v]))
    }

    /// The faces in pieces that hang together across edges.
    pub(crate) fn pieces(&self, faces: &[FaceId]) -> Vec<Vec<FaceId>> {
        let local = self.places(std::iter::once(faces));
        let mut sets = DisjointSets::<FaceId>::new(self.mesh.triangles.len());
        for &face in faces {
            let near = self.adjacency.neighbours(face).into_iter().flatten();
            near.filter(|&other| local[other].is_some()).for_each(|other| sets.join(face, other));
        }
        let mut pieces: Vec<Vec<FaceId>> = Vec::new();
        let mut piece_of = IdVec::<FaceId, usize>::filled(usize::MAX, self.mesh.triangles.len());
        for &face in faces {
            let root = sets.root(face);
            if piece_of[root] == usize::MAX {
                piece_of[root] = pieces.len();
                pieces.push(Vec::new());
            }
            pieces[piece_of[root]].push(face);
        }
        pieces
    }

    /// Which charts share a border, the longest first.
    pub(crate) fn borders(&self, charts: &[&[FaceId]]) -> Vec<[usize; 2]> {
        let places = self.places(charts.iter().copied());
        let mut lengths = BTreeMap::<[usize; 2], f64>::new();
        let sides = |face| [0, 1, 2].map(|side| Halfedge::new(face, side));
        for h in self.mesh.triangles.ids().flat_map(sides) {
            let Some(twin) = self.adjacency.twin(h).filter(|twin| h < *twin) else { continue };
            let [Some((a, _)), Some((b, _))] = [h, twin].map(|h| places[h.face()]) else { continue };
            if a != b {
                let [from, to] = [h.start(self.mesh), h.end(self.mesh)].map(|v| self.mesh.positions[v]);
                *lengths.entry([a.min(b), a.max(b)]).or_default() += from.distance(to);
            }
        }
        let (pairs, lengths): (Vec<_>, Vec<_>) = lengths.into_iter().unzip();
        order_by(pairs.len(), &|a, b| lengths[b].total_cmp(&lengths[a]))
            .into_iter()
            .map(|k| pairs[k])
            .collect()
    }

    /// The patch cut along the borders of charts that hold all of its faces, and along their cuts.
    pub(crate) fn cut(&self, charts: &[Chart]) -> CutMesh {
        let places = self.places(charts.iter().map(|chart| chart.faces.as_slice()));
        let across = |h: Halfedge| {
            let twin = self.adjacency.twin(h)?;
            let [(chart, face), (other, other_face)] = [places[h.face()]?, places[twin.face()]?];
            if chart != other {
                return None;
            }
            let is_whole = charts[chart].cut.as_ref().is_none_or(|cut| {
                cut.is_whole(Halfedge::new(face, h.side()), Halfedge::new(other_face, twin.side()))
            });
            is_whole.then_some(twin)
        };
        CutMesh::new(&self.mesh.triangles, self.mesh.positions.len(), across)
    }

    /// The chart of each face and its number there.
    fn places<'f>(
        &self,
        charts: impl Iterator<Item = &'f [FaceId]>,
    ) -> IdVec<FaceId, Option<(usize, FaceId)>> {
        let mut places = IdVec::filled(None, self.mesh.triangles.len());
        for (chart, faces) in charts.enumerate() {
            for (k, &face) in faces.iter().enumerate() {
                places[face] = Some((chart, FaceId::new(k)));
            }
        }
        places
    }
}
