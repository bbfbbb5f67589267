//! The neighbours in a mesh that does not change.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::connectivity::edges::{loops_of, pair_halfedges};
use crate::mesh::connectivity::topology::Topology;
use crate::mesh::{Halfedge, MeshError, TriMesh};
use crate::numeric::{Csr, DisjointSets};
use crate::parallel::par_ids;

/// The neighbours of every vertex and face of an oriented manifold mesh with boundary.
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

/// The one-rings of an oriented manifold that does not change, in the order of
/// [`crate::mesh::Adjacency`]. Several sweeps read them, and a walk from face to face would wait for
/// memory at each.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rings {
    neighbours: Csr<VertexId>,
    pub(crate) on_boundary: IdVec<VertexId, bool>,
}

impl Rings {
    /// Rings of these numbers of neighbours, which `fill` writes, in parallel.
    pub(super) fn fill(
        on_boundary: IdVec<VertexId, bool>,
        degrees: &IdVec<VertexId, u32>,
        fill: impl Fn(VertexId, &mut [VertexId]) + Sync,
    ) -> Self {
        let neighbours = Csr::filled(degrees, |row, ring| fill(VertexId::new(row), ring));
        Self { neighbours, on_boundary }
    }

    #[inline]
    pub(crate) fn of(&self, v: VertexId) -> &[VertexId] {
        &self.neighbours[v.index()]
    }

    pub(super) fn edges(&self) -> usize {
        self.neighbours.items().len() / 2
    }

    pub(crate) fn vertices(&self) -> usize {
        self.on_boundary.len()
    }

    /// `of` every vertex and its ring, in parallel.
    pub(crate) fn map(&self, of: impl Fn(VertexId, &[VertexId]) -> f64 + Sync) -> IdVec<VertexId, f64> {
        par_ids(self.vertices(), |v| of(v, self.of(v)))
    }

    /// The boundary loops, each from its smallest vertex, faces on the left; sorted by that vertex.
    pub(crate) fn boundary_loops(&self) -> Vec<Vec<VertexId>> {
        let on_boundary = self.on_boundary.enumerate().filter(|(_, is_on)| **is_on);
        loops_of(&on_boundary.map(|(v, _)| [v, self.of(v)[0]]).collect::<Vec<_>>())
    }
}

/// The faces around a vertex as they are counted.
#[derive(Debug, Clone, Copy)]
struct Fan {
    first: Halfedge,
    faces: u32,
    is_open: bool,
}

impl Default for Fan {
    fn default() -> Self {
        Self { first: Halfedge::NONE, faces: 0, is_open: false }
    }
}

impl Fan {
    /// Number of neighbours if all faces are of one fan.
    fn neighbours(&self) -> u32 {
        self.faces + u32::from(self.is_open)
    }
}

/// Writes the neighbours around the fan of halfedge `first` into `ring`, counter-clockwise; whether
/// they fill it.
fn walk(
    mesh: &TriMesh,
    twins: &IdVec<FaceId, [Halfedge; 3]>,
    first: Halfedge,
    ring: &mut [VertexId],
) -> bool {
    let mut here = first;
    let mut ring = ring.iter_mut();
    while let Some(neighbour) = ring.next() {
        let (corners, back) = (&mesh.triangles[here.face()], here.previous());
        *neighbour = corners[here.next().side()];
        let twin = twins[back.face()][back.side()];
        if twin == Halfedge::NONE {
            let last = ring.next().map(|last| *last = corners[back.side()]);
            return last.is_some() && ring.len() == 0;
        }
        if twin == first {
            return ring.len() == 0;
        }
        here = twin;
    }
    false
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

    /// The adjacency of a mesh, and where the ring of each vertex starts: at the halfedge along the
    /// boundary if there is one, else at any.
    pub(super) fn with_starts(mesh: &TriMesh) -> Result<(Self, IdVec<VertexId, Halfedge>), MeshError> {
        mesh.validate()?;
        let vertices = mesh.positions.len();
        let twins = pair_halfedges(&mesh.triangles, vertices)?;
        // One array, so that a corner waits for memory once.
        let mut fans = IdVec::<VertexId, Fan>::filled(Fan::default(), vertices);
        for (face, corners) in mesh.triangles.enumerate() {
            for (side, &v) in corners.iter().enumerate() {
                let fan = &mut fans[v];
                let is_open = twins[face][side] == Halfedge::NONE;
                if is_open || fan.faces == 0 {
                    fan.first = Halfedge::new(face, side);
                }
                fan.faces += 1;
                fan.is_open |= is_open;
            }
        }
        let is_broken = AtomicBool::new(false);
        let rings = Rings::fill(fans.map(|fan| fan.is_open), &fans.map(Fan::neighbours), |v, ring| {
            if !walk(mesh, &twins, fans[v].first, ring) {
                is_broken.store(true, Ordering::Relaxed);
            }
        });
        let adjacency = Self { twins, rings };
        if is_broken.into_inner() {
            return Err(adjacency.broken_vertex(mesh, &fans));
        }
        Ok((adjacency, fans.map(|fan| fan.first)))
    }

    /// The first vertex without a face or with several fans.
    fn broken_vertex(&self, mesh: &TriMesh, fans: &IdVec<VertexId, Fan>) -> MeshError {
        let is_broken = |&(v, fan): &(VertexId, &Fan)| {
            !walk(mesh, &self.twins, fan.first, &mut vec![v; fan.neighbours() as usize])
        };
        match fans.enumerate().find(is_broken) {
            Some((vertex, fan)) if fan.faces > 0 => {
                MeshError::NonManifoldVertex { vertex, fans: self.count_fans(mesh, vertex) }
            }
            found => MeshError::IsolatedVertex { vertex: found.map(|(v, _)| v).unwrap_or_default() },
        }
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
    pub fn ring(&self, v: VertexId) -> &[VertexId] {
        self.rings.of(v)
    }

    /// Whether `v` lies on a boundary loop.
    #[inline]
    pub fn is_boundary(&self, v: VertexId) -> bool {
        self.rings.on_boundary[v]
    }

    /// The face across each side, from corner `k` to the next; `None` on the boundary.
    #[inline]
    pub fn neighbours(&self, face: FaceId) -> [Option<FaceId>; 3] {
        [0, 1, 2].map(|side| self.twin(Halfedge::new(face, side)).map(Halfedge::face))
    }

    /// The halfedge on the other side, or `None` on the boundary.
    pub(crate) fn twin(&self, h: Halfedge) -> Option<Halfedge> {
        let twin = self.twins[h.face()][h.side()];
        (twin != Halfedge::NONE).then_some(twin)
    }

    /// Vertices minus edges plus faces: 1 for a disk, 2 for a sphere, one less for each hole.
    pub fn euler_characteristic(&self) -> i64 {
        let count = |n: usize| i64::try_from(n).expect("counts fit into 63 bits");
        count(self.rings.vertices()) - count(self.rings.edges()) + count(self.twins.len())
    }

    /// The boundary loops, each from its smallest vertex, faces on the left; sorted by that vertex.
    pub fn boundary_loops(&self) -> Vec<Vec<VertexId>> {
        self.rings.boundary_loops()
    }

    /// What the surface is up to deformation.
    pub(crate) fn topology(&self) -> Topology {
        let mut sets = DisjointSets::<FaceId>::new(self.twins.len());
        for face in self.twins.ids() {
            let smaller = self.neighbours(face).into_iter().flatten().filter(|other| *other < face);
            smaller.for_each(|other| sets.join(face, other));
        }
        let (euler, loops) = (self.euler_characteristic(), self.boundary_loops().len());
        Topology { components: sets.labels().count, loops, euler }
    }
}
