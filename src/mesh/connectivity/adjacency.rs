//! Who borders whom in a mesh that rests.

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{
        Halfedge, MeshError, TriMesh,
        connectivity::{edges::pair_halfedges, rings::Rings},
    },
    numeric::DisjointSets,
};

/// Who borders whom in an oriented manifold mesh with boundary.
///
/// One-rings run counter-clockwise seen from outside. The ring of a boundary vertex is an open
/// chain: its first entry is the next vertex along the boundary loop, its last the previous one.
///
/// ```
/// use dermatome::mesh::{Adjacency, shapes};
///
/// let tube = shapes::tube(8, 4, 0.03, 0.1);
/// let adjacency = Adjacency::new(&tube)?;
/// assert_eq!(adjacency.boundary_loops().len(), 2);
/// assert_eq!(adjacency.euler_characteristic(), 0);
/// # Ok::<(), dermatome::mesh::MeshError>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct Adjacency {
    /// The halfedge on the other side of each.
    pub(super) twins: IdVec<FaceId, [Halfedge; 3]>,
    pub(super) rings: Rings,
}

impl Adjacency {
    /// Finds the neighbours of every vertex and face.
    ///
    /// # Errors
    /// If corners are out of range, an edge has more than two faces or two that run the same way,
    /// a vertex has more than one fan of faces, or none.
    pub fn new(mesh: &TriMesh) -> Result<Self, MeshError> {
        Ok(Self::with_starts(mesh)?.0)
    }

    /// The same, and where the ring of each vertex starts: at the halfedge along the boundary if
    /// there is one, else at any.
    pub(super) fn with_starts(mesh: &TriMesh) -> Result<(Self, IdVec<VertexId, Halfedge>), MeshError> {
        mesh.validate()?;
        let vertices = mesh.positions.len();
        let mut adjacency = Self {
            twins: pair_halfedges(&mesh.triangles, vertices)?,
            rings: Rings {
                starts: Vec::with_capacity(vertices + 1),
                neighbours: Vec::with_capacity(3 * mesh.triangles.len() + vertices),
                on_boundary: IdVec::filled(false, vertices),
            },
        };
        let mut first = IdVec::<VertexId, Halfedge>::filled(Halfedge::NONE, vertices);
        let mut degrees = IdVec::<VertexId, u32>::filled(0, vertices);
        for (face, corners) in mesh.triangles.enumerate() {
            for (side, &v) in corners.iter().enumerate() {
                degrees[v] += 1;
                let is_open = adjacency.twins[face][side] == Halfedge::NONE;
                if is_open || first[v] == Halfedge::NONE {
                    first[v] = Halfedge::new(face, side);
                }
                adjacency.rings.on_boundary[v] |= is_open;
            }
        }
        adjacency.rings.starts.push(0);
        for v in mesh.positions.ids() {
            if degrees[v] == 0 {
                return Err(MeshError::IsolatedVertex { vertex: v });
            }
            if adjacency.push_ring(mesh, first[v]) != degrees[v] {
                return Err(MeshError::NonManifoldVertex { vertex: v, fans: adjacency.count_fans(mesh, v) });
            }
        }
        Ok((adjacency, first))
    }

    /// Walks the fan of halfedge `first` counter-clockwise, and says how many faces it has.
    fn push_ring(&mut self, mesh: &TriMesh, first: Halfedge) -> u32 {
        let mut here = first;
        let mut faces = 0;
        loop {
            let corners = &mesh.triangles[here.face()];
            let back = here.previous();
            self.rings.neighbours.push(corners[here.next().side()]);
            faces += 1;
            let twin = self.twins[back.face()][back.side()];
            if twin == Halfedge::NONE {
                self.rings.neighbours.push(corners[back.side()]);
                break;
            }
            if twin == first {
                break;
            }
            here = twin;
        }
        self.rings.starts.push(VertexId::new(self.rings.neighbours.len()).raw());
        faces
    }

    /// Number of fans around `v`; looks through the whole mesh, for an error message alone.
    fn count_fans(&self, mesh: &TriMesh, v: VertexId) -> usize {
        let star: Vec<FaceId> = mesh.triangles.ids().filter(|&f| mesh.triangles[f].contains(&v)).collect();
        let mut fans = DisjointSets::<FaceId>::new(self.twins.len());
        for h in star.iter().flat_map(|&face| [0, 1, 2].map(|side| Halfedge::new(face, side))) {
            if let Some(twin) = self.twin(h).filter(|_| h.start(mesh) == v || h.end(mesh) == v) {
                fans.join(h.face(), twin.face());
            }
        }
        star.into_iter().filter(|&face| fans.root(face) == face).count()
    }

    /// The neighbours of `v`, counter-clockwise; for a boundary vertex from the next to the
    /// previous vertex of its loop.
    #[inline]
    #[must_use]
    pub fn ring(&self, v: VertexId) -> &[VertexId] {
        self.rings.of(v)
    }

    /// Whether `v` lies on a boundary loop.
    #[inline]
    #[must_use]
    pub fn is_boundary(&self, v: VertexId) -> bool {
        self.rings.on_boundary[v]
    }

    /// The face across each side, from corner `k` to the next; `None` on the boundary.
    #[inline]
    #[must_use]
    pub fn neighbours(&self, face: FaceId) -> [Option<FaceId>; 3] {
        [0, 1, 2].map(|side| self.twin(Halfedge::new(face, side)).map(Halfedge::face))
    }

    /// The halfedge on the other side, or `None` on the boundary.
    pub(crate) fn twin(&self, h: Halfedge) -> Option<Halfedge> {
        let twin = self.twins[h.face()][h.side()];
        (twin != Halfedge::NONE).then_some(twin)
    }

    /// Vertices minus edges plus faces: 1 for a disk, 2 for a sphere, one less for each hole.
    #[must_use]
    pub fn euler_characteristic(&self) -> i64 {
        let count = |n: usize| i64::try_from(n).expect("counts fit into 63 bits");
        count(self.rings.vertices()) - count(self.rings.neighbours.len() / 2) + count(self.twins.len())
    }

    /// The boundary loops, each from its smallest vertex, faces on the left; sorted by that vertex.
    #[must_use]
    pub fn boundary_loops(&self) -> Vec<Vec<VertexId>> {
        self.rings.boundary_loops()
    }

    pub(crate) fn component_count(&self) -> usize {
        let mut sets = DisjointSets::<FaceId>::new(self.twins.len());
        for face in self.twins.ids() {
            self.neighbours(face).into_iter().flatten().for_each(|other| sets.join(face, other));
        }
        self.twins.ids().filter(|&face| sets.root(face) == face).count()
    }
}
