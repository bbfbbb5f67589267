//! The neighbours in a mesh that does not change.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::connectivity::edges::{first_crowded, loops_of};
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

/// The one-rings of an oriented manifold that does not change, in the order of [`crate::mesh::Adjacency`].
/// Several sweeps read them; a walk from face to face would miss the cache at every step.
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
        let neighbours = Csr::filled(degrees.as_slice(), |row, ring| fill(VertexId::new(row), ring));
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

/// A face at a vertex, with the neighbours along its two sides there.
#[derive(Debug, Clone, Copy)]
struct Link {
    next: VertexId,
    previous: VertexId,
    /// The halfedge that leaves the corner.
    corner: Halfedge,
}

/// Up to this many links of a vertex are searched one by one; more are sorted.
const FEW: usize = 16;

/// Finds the link with a vertex as its `key`.
fn search<'a>(
    links: &'a [Link],
    key: impl Fn(&Link) -> VertexId + Copy + 'a,
) -> impl Fn(VertexId) -> Option<Link> + 'a {
    let mut sorted = if links.len() > FEW { links.to_vec() } else { Vec::new() };
    sorted.sort_unstable_by_key(key);
    move |v| {
        if sorted.is_empty() {
            return links.iter().find(|link| key(link) == v).copied();
        }
        sorted.binary_search_by_key(&v, key).ok().map(|place| sorted[place])
    }
}

/// Writes the neighbours of a vertex, whose faces are `links`, into `ring`, counter-clockwise. Returns
/// whether they are one fan that fills `ring`. Calls `pair` with every halfedge that leaves the vertex and
/// its twin.
///
/// Faster than walking from face to face, which would miss the cache at every step.
fn order_fan(links: &[Link], ring: &mut [VertexId], pair: impl Fn(Halfedge, Halfedge)) -> bool {
    let is_open = ring.len() > links.len();
    let with_next = search(links, |link| link.next);
    let with_previous = search(links, |link| link.previous);
    let mut first = links.first();
    for link in links {
        match with_previous(link.next) {
            Some(before) => pair(link.corner, before.corner.previous()),
            None => first = Some(link),
        }
    }
    let Some(&first) = first else { return false };
    let (mut here, mut ring) = (first, ring.iter_mut());
    while let Some(neighbour) = ring.next() {
        *neighbour = here.next;
        match with_next(here.previous) {
            Some(after) if after.corner == first.corner => return ring.len() == 0 && !is_open,
            Some(after) => here = after,
            None => {
                let last = ring.next().map(|last| *last = here.previous);
                return last.is_some() && ring.len() == 0 && is_open;
            }
        }
    }
    false
}

impl Adjacency {
    /// Finds the neighbours of every vertex and face.
    ///
    /// # Errors
    /// If corners are out of range, an edge has more than two faces or two in the same direction,
    /// a vertex has more than one fan of faces, or none.
    pub fn new(mesh: &TriMesh) -> Result<Self, MeshError> {
        Ok(Self::with_starts(mesh)?.0)
    }

    /// The adjacency of a mesh, and the halfedge at which the ring of each vertex starts: the one along the
    /// boundary if there is one, else that of the first face.
    pub(super) fn with_starts(mesh: &TriMesh) -> Result<(Self, IdVec<VertexId, Halfedge>), MeshError> {
        mesh.validate()?;
        let (triangles, vertices) = (&mesh.triangles, mesh.positions.len());
        let links = triangles.enumerate().flat_map(|(face, t)| {
            [[0, 1, 2], [1, 2, 0], [2, 0, 1]].map(|[side, next, previous]| {
                let corner = Halfedge::new(face, side);
                (t[side].index(), Link { next: t[next], previous: t[previous], corner })
            })
        });
        let links = Csr::from_pairs(vertices, links);
        // Every neighbour of a closed fan is the next one of one face and the previous one of another.
        let on_boundary: IdVec<VertexId, bool> = par_ids(vertices, |v: VertexId| {
            let difference = |link: &Link| link.next.raw().wrapping_sub(link.previous.raw());
            links[v.index()].iter().map(difference).fold(0, u32::wrapping_add) != 0
        });
        let faces = |v: VertexId| u32::try_from(links[v.index()].len()).expect("fewer than halfedges");
        let degrees = on_boundary.enumerate().map(|(v, &open)| faces(v) + u32::from(open)).collect();
        let none = || AtomicU32::new(Halfedge::NONE.raw());
        let twins: Vec<[AtomicU32; 3]> = triangles.iter().map(|_| [none(), none(), none()]).collect();
        let is_broken = AtomicBool::new(false);
        let rings = Rings::fill(on_boundary, &degrees, |v, ring| {
            // Each halfedge leaves one vertex.
            let pair = |h: Halfedge, twin: Halfedge| {
                twins[h.face().index()][h.side()].store(twin.raw(), Ordering::Relaxed);
            };
            if !order_fan(&links[v.index()], ring, pair) {
                is_broken.store(true, Ordering::Relaxed);
            }
        });
        let halfedges = |twins: [AtomicU32; 3]| twins.map(|twin| Halfedge::from_raw(twin.into_inner()));
        let adjacency = Self { twins: twins.into_iter().map(halfedges).collect(), rings };
        if is_broken.into_inner() {
            return Err(first_crowded(mesh).unwrap_or_else(|| adjacency.broken_vertex(&links)));
        }
        let start = |v: VertexId| {
            let mut corners = links[v.index()].iter().map(|link| link.corner);
            corners.find(|h| !adjacency.is_boundary(v) || adjacency.twin(*h).is_none()).unwrap_or_default()
        };
        let starts = mesh.positions.ids().map(start).collect();
        Ok((adjacency, starts))
    }

    /// The first vertex without a face or with several fans, of a mesh without crowded edges.
    fn broken_vertex(&self, links: &Csr<Link>) -> MeshError {
        let mut vertices = self.rings.on_boundary.ids();
        let is_broken = |v: &VertexId| !order_fan(&links[v.index()], &mut self.ring(*v).to_vec(), |_, _| ());
        let vertex = vertices.find(is_broken).unwrap_or_default();
        let star = || links[vertex.index()].iter().map(|link| link.corner);
        let mut fans = DisjointSets::<FaceId>::new(self.twins.len());
        for h in star() {
            self.twin(h).into_iter().for_each(|twin| fans.join(h.face(), twin.face()));
        }
        match star().filter(|h| fans.root(h.face()) == h.face()).count() {
            0 => MeshError::IsolatedVertex { vertex },
            fans => MeshError::NonManifoldVertex { vertex, fans },
        }
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
        Halfedge::of_face(face).map(|h| self.twin(h).map(Halfedge::face))
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

    /// The topology of the surface.
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
