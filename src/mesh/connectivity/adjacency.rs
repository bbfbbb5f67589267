//! Who borders whom in a mesh that rests.

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{
        Halfedge, MeshError, TriMesh,
        connectivity::{edges::pair_halfedges, rings::Rings},
    },
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
        // Where each fan starts: the halfedge along the boundary if there is one, else any.
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
        Ok(adjacency)
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
        let halfedges = mesh.triangles.ids().flat_map(|face| [0, 1, 2].map(|k| Halfedge::new(face, k)));
        // Ascending, so that a binary search finds the place of a halfedge.
        let leaving: Vec<Halfedge> = halfedges.filter(|h| h.start(mesh) == v).collect();
        let mut seen = vec![false; leaving.len()];
        let mut fans = 0;
        // Open fans first, each from its one open end; what is left then are closed fans.
        for open in [true, false] {
            for at in 0..leaving.len() {
                if seen[at] || (open && self.twin(leaving[at]).is_some()) {
                    continue;
                }
                fans += 1;
                let mut at = at;
                while !seen[at] {
                    seen[at] = true;
                    let next = self.twin(leaving[at].previous());
                    if let Some(place) = next.and_then(|next| leaving.binary_search(&next).ok()) {
                        at = place;
                    }
                }
            }
        }
        fans
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
        self.rings.is_boundary(v)
    }

    /// The halfedge on the other side, or `None` on the boundary.
    #[inline]
    #[must_use]
    pub fn twin(&self, h: Halfedge) -> Option<Halfedge> {
        let twin = self.twins[h.face()][h.side()];
        (twin != Halfedge::NONE).then_some(twin)
    }

    /// Number of undirected edges.
    #[must_use]
    pub fn edge_count(&self) -> usize {
        self.rings.edges()
    }

    /// Vertices minus edges plus faces: 1 for a disk, 2 for a sphere, one less for each hole.
    #[must_use]
    pub fn euler_characteristic(&self) -> i64 {
        let count = |n: usize| i64::try_from(n).expect("counts fit into 63 bits");
        count(self.rings.vertices()) - count(self.edge_count()) + count(self.twins.len())
    }

    /// The boundary loops, each from its smallest vertex, faces on the left; sorted by that vertex.
    #[must_use]
    pub fn boundary_loops(&self) -> Vec<Vec<VertexId>> {
        self.rings.boundary_loops()
    }

    /// The component of every face, numbered in the order of their first faces, and their number.
    #[must_use]
    pub fn components(&self) -> (IdVec<FaceId, u32>, usize) {
        const NONE: u32 = u32::MAX;
        let mut of_face = IdVec::<FaceId, u32>::filled(NONE, self.twins.len());
        let mut count = 0_u32;
        let mut stack = Vec::new();
        for seed in of_face.ids() {
            if of_face[seed] != NONE {
                continue;
            }
            of_face[seed] = count;
            stack.push(seed);
            while let Some(face) = stack.pop() {
                for twin in self.twins[face].into_iter().filter(|&twin| twin != Halfedge::NONE) {
                    if of_face[twin.face()] == NONE {
                        of_face[twin.face()] = count;
                        stack.push(twin.face());
                    }
                }
            }
            count += 1;
        }
        (of_face, count as usize)
    }
}
