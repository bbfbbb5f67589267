//! A mesh cut open: the same faces, with the vertices of the seam doubled.

use glam::DVec3;

use crate::cut::CutError;
use crate::id::{FaceId, IdVec, VertexId, define_id};
use crate::mesh::{
    Adjacency, AlongCurve, Halfedge, Topology, TriMesh, boundary_edges, joined_corners, loops_of,
};

define_id!(
    /// A place of a map: a vertex of the mesh as it lies on the map, perhaps cut open. A vertex of the seam has
    /// several places; where nothing is cut, each vertex is the place of the same number.
    pub PlaceId, "place"
);

impl PlaceId {
    /// The first place of a vertex of the level: copies follow after all vertices.
    #[inline]
    pub fn first_of(vertex: VertexId) -> Self {
        Self(vertex.raw())
    }

    /// The place that a vertex of the mesh after the cut is.
    pub fn of_opened(vertex: VertexId) -> Self {
        Self(vertex.raw())
    }

    /// The vertex of the mesh after the cut that the place is.
    pub fn opened(self) -> VertexId {
        VertexId::from(self.0)
    }
}

/// The faces of a mesh after a cut.
///
/// The cut mesh has the faces of the uncut one, in the same order with the same corners, so a face
/// and barycentric coordinates in it mean the same point of both. A vertex of the seam is several
/// vertices of the cut mesh: itself, and copies that follow after all vertices of the uncut mesh.
#[derive(Debug, Clone, PartialEq)]
pub struct CutMesh {
    /// The corners of every face, as vertices of the cut mesh.
    pub triangles: IdVec<FaceId, [PlaceId; 3]>,
    /// The vertex of the uncut mesh that each vertex of the cut mesh is. The first ones are
    /// themselves.
    pub unsplit: IdVec<PlaceId, VertexId>,
}

impl CutMesh {
    /// Cuts a mesh of `vertices` vertices open. `across` leads from a halfedge to its twin, or
    /// nowhere at a boundary and at the seam.
    pub(super) fn new(
        triangles: &IdVec<FaceId, [VertexId; 3]>,
        vertices: usize,
        across: impl Fn(Halfedge) -> Option<Halfedge>,
    ) -> Self {
        let mut corners = joined_corners(triangles.len(), across);
        let mut unsplit: IdVec<PlaceId, VertexId> = (0..vertices).map(VertexId::new).collect();
        let mut is_taken = IdVec::<VertexId, bool>::filled(false, vertices);
        let mut names = IdVec::<FaceId, [PlaceId; 3]>::filled([PlaceId::default(); 3], triangles.len());
        // A set is named by its first corner, which comes first here too.
        for h in triangles.ids().flat_map(Halfedge::of_face) {
            let root = corners.root(h);
            let v = triangles[h.face()][h.side()];
            names[h.face()][h.side()] = if root != h {
                names[root.face()][root.side()]
            } else if is_taken[v] {
                unsplit.push(v)
            } else {
                is_taken[v] = true;
                PlaceId::first_of(v)
            };
        }
        Self { triangles: names, unsplit }
    }

    /// The cut of the same mesh along a curve. Places that are copies of vertices keep their numbers.
    pub(crate) fn along(&self, curve: &AlongCurve) -> Self {
        let number = |v: VertexId| curve.numbers[v];
        let corner = |h: Halfedge| self.moved(self.triangles[h.face()][h.side()], number);
        let unsplit =
            self.unsplit.enumerate().map(|(place, &v)| if is_first(place, v) { v } else { number(v) });
        Self {
            triangles: curve.given_corners().map(|corners| corners.map(corner)).collect(),
            unsplit: unsplit.collect(),
        }
    }

    /// A place after the vertices of the uncut mesh have got other numbers; copies keep theirs.
    pub(crate) fn moved(&self, place: PlaceId, number: impl Fn(VertexId) -> VertexId) -> PlaceId {
        let v = self.unsplit[place];
        if is_first(place, v) { PlaceId::first_of(number(v)) } else { place }
    }

    /// The cut mesh, with the positions of the vertices of the uncut one (m).
    #[doc(hidden)]
    pub fn mesh(&self, positions: &IdVec<VertexId, DVec3>) -> TriMesh {
        let positions = self.unsplit.map(|&v| positions[v]);
        TriMesh {
            positions: positions.reindexed(),
            triangles: self.triangles.map(|corners| corners.map(PlaceId::opened)),
        }
    }

    /// A vertex of the cut mesh that breaks its rules; `None` if all are as they should be.
    pub(crate) fn wrong_place(&self, uncut: &TriMesh) -> Option<PlaceId> {
        let count = uncut.positions.len();
        let is_wrong = |(place, v): &(PlaceId, &VertexId)| {
            if place.index() < count { v.index() != place.index() } else { v.index() >= count }
        };
        let of_face = |(corners, whole): (&[PlaceId; 3], &[VertexId; 3])| {
            (0..3).find(|&k| self.unsplit.get(corners[k]) != Some(&whole[k])).map(|k| corners[k])
        };
        if self.unsplit.len() < count || self.triangles.len() != uncut.triangles.len() {
            return Some(PlaceId::new(self.unsplit.len()));
        }
        let first = self.unsplit.enumerate().find(is_wrong).map(|(place, _)| place);
        first.or_else(|| self.triangles.iter().zip(&uncut.triangles).find_map(of_face))
    }

    /// The edges of the seam in the uncut mesh, smaller vertex first, sorted.
    /// Fails if `uncut` is not an oriented manifold.
    pub(crate) fn seam(&self, uncut: &TriMesh) -> Result<Vec<[VertexId; 2]>, CutError> {
        Ok(self.seam_edges(uncut, &Adjacency::new(uncut)?))
    }

    /// As [`Self::seam`], for a mesh whose adjacency is known.
    pub(crate) fn seam_edges(&self, uncut: &TriMesh, adjacency: &Adjacency) -> Vec<[VertexId; 2]> {
        let mut seam = Vec::new();
        for face in uncut.triangles.ids() {
            for h in Halfedge::of_face(face) {
                let Some(twin) = adjacency.twin(h).filter(|twin| *twin > h) else { continue };
                if !self.is_whole(h, twin) {
                    let [a, b] = [h.start(uncut), h.end(uncut)];
                    seam.push([a.min(b), a.max(b)]);
                }
            }
        }
        seam.sort_unstable();
        seam
    }

    /// Whether two halfedges of one uncut edge are one edge of the cut mesh too.
    pub(crate) fn is_whole(&self, h: Halfedge, twin: Halfedge) -> bool {
        let at = |h: Halfedge| self.triangles[h.face()][h.side()];
        at(h) == at(twin.next()) && at(h.next()) == at(twin)
    }
}

/// Whether a place of a vertex is its first one, no copy.
fn is_first(place: PlaceId, vertex: VertexId) -> bool {
    place == PlaceId::first_of(vertex)
}

/// Length of edges of a mesh, in m.
pub(crate) fn seam_length(mesh: &TriMesh, edges: &[[VertexId; 2]]) -> f64 {
    edges.iter().map(|&[a, b]| mesh.positions[a].distance(mesh.positions[b])).sum()
}

/// Whether a mesh, an oriented manifold of one component, is a disk without holes.
#[doc(hidden)]
pub fn is_plain_disk(mesh: &TriMesh) -> bool {
    let rim = boundary_edges(mesh);
    // Vertices - edges + faces = 1, where each edge but those of the rim is the side of two faces.
    2 * mesh.positions.len() == mesh.triangles.len() + rim.len() + 2 && loops_of(&rim).len() == 1
}

/// Refuses a mesh that is not one disk with holes. `vertex` is one of the seam, to name it.
pub(super) fn check_disk(mesh: &TriMesh, vertex: VertexId) -> Result<(), CutError> {
    let topology = Adjacency::new(mesh)?.topology();
    match topology {
        _ if topology.is_disk() => Ok(()),
        Topology { components: 1, euler, loops } => Err(CutError::NotADisk { euler, loops }),
        Topology { components, .. } => Err(CutError::Disconnects { vertex, components }),
    }
}
