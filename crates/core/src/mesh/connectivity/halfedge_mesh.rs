//! A manifold that changes: stars of vertices are replaced by fewer triangles, in place, and edges are split,
//! flipped and collapsed. Topology alone: the caller keeps the positions.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::connectivity::adjacency::Rings;
use crate::mesh::{Adjacency, Halfedge, MeshError, TriMesh, triangle_cross};

/// Two vertices with more neighbours than this count as neighbours without a walk: between two hubs of a
/// thousand spokes the removal of every spoke would repeat it.
const MAX_WALK: u32 = 256;

/// Most neighbours of a vertex whose star can be replaced: the size of buffers.
pub(crate) const MAX_RING: usize = 32;

/// A face with its neighbours: a walk reads both from one cache line.
#[derive(Debug, Clone, Copy)]
struct Face {
    /// Corners, counter-clockwise seen from outside.
    corners: [VertexId; 3],
    /// The halfedge across the side from corner `k` to the next.
    twins: [Halfedge; 3],
}

/// An oriented manifold that changes: halfedges on flat arrays.
///
/// Removing a vertex reuses the slots of its star, so nothing is allocated and vertex ids stay;
/// slots that are left over are marked dead and removed by [`HalfedgeMesh::compact`].
#[derive(Debug, Clone)]
pub(crate) struct HalfedgeMesh {
    faces: IdVec<FaceId, Face>,
    alive: IdVec<FaceId, bool>,
    /// A halfedge that leaves each vertex: the boundary's where there is one, none for a removed
    /// vertex.
    pub(crate) leaving: IdVec<VertexId, Halfedge>,
    pub(crate) on_boundary: IdVec<VertexId, bool>,
    pub(crate) degree: IdVec<VertexId, u32>,
}

/// New ids of the vertices and faces that [`HalfedgeMesh::compact`] keeps.
pub(crate) struct Compacted {
    pub(crate) mesh: HalfedgeMesh,
    pub(crate) old_vertices: IdVec<VertexId, VertexId>,
    /// The new id of every old face; meaningless for dead ones.
    pub(crate) new_faces: IdVec<FaceId, FaceId>,
}

#[cfg_attr(not(feature = "robots"), expect(dead_code, reason = "remeshing alone changes edges"))]
impl HalfedgeMesh {
    /// The halfedges of a mesh, and its one-rings, which are valid until it changes.
    pub(crate) fn new(mesh: &TriMesh) -> Result<(Self, Rings), MeshError> {
        let (Adjacency { twins, rings }, leaving) = Adjacency::with_starts(mesh)?;
        let degree = |v: VertexId| u32::try_from(rings.of(v).len()).expect("fewer neighbours than vertices");
        let faces = mesh.triangles.iter().zip(twins);
        let this = Self {
            faces: faces.map(|(&corners, twins)| Face { corners, twins }).collect(),
            alive: IdVec::filled(true, mesh.triangles.len()),
            leaving,
            on_boundary: rings.on_boundary.clone(),
            degree: mesh.positions.ids().map(degree).collect(),
        };
        Ok((this, rings))
    }

    /// The corners of `face`, counter-clockwise seen from outside.
    #[inline]
    pub(crate) fn corners(&self, face: FaceId) -> [VertexId; 3] {
        self.faces[face].corners
    }

    /// The corners of all faces, dead ones included.
    pub(crate) fn triangles(&self) -> IdVec<FaceId, [VertexId; 3]> {
        self.faces.map(|face| face.corners)
    }

    pub(crate) fn is_alive(&self, face: FaceId) -> bool {
        self.alive[face]
    }

    /// All faces, dead ones included.
    pub(crate) fn face_ids(&self) -> impl Iterator<Item = FaceId> + use<> {
        (0..self.faces.len()).map(FaceId::new)
    }

    /// Number of faces, dead ones included.
    pub(crate) fn face_count(&self) -> usize {
        self.faces.len()
    }

    /// The halfedges of the faces there are now, dead ones included.
    pub(crate) fn halfedges(&self) -> impl Iterator<Item = Halfedge> + use<> {
        self.face_ids().flat_map(|face| [0, 1, 2].map(|side| Halfedge::new(face, side)))
    }

    /// Whether `h` represents its edge: of the halfedges of each edge of a living face exactly one does.
    pub(crate) fn is_edge(&self, h: Halfedge) -> bool {
        let twin = self.twin(h);
        self.alive[h.face()] && (twin == Halfedge::NONE || h.raw() < twin.raw())
    }

    pub(crate) fn origin(&self, h: Halfedge) -> VertexId {
        self.faces[h.face()].corners[h.side()]
    }

    pub(crate) fn target(&self, h: Halfedge) -> VertexId {
        self.origin(h.next())
    }

    /// The corner of the face of `h` that is not on it.
    pub(crate) fn apex(&self, h: Halfedge) -> VertexId {
        self.origin(h.previous())
    }

    /// The ends of an inner edge, and the corners across it on the side of `h` and on the other.
    pub(crate) fn diamond(&self, h: Halfedge) -> [VertexId; 4] {
        [self.origin(h), self.target(h), self.apex(h), self.apex(self.twin(h))]
    }

    /// The halfedges that leave `v`, one for each of its faces, counter-clockwise.
    pub(crate) fn leaving(&self, v: VertexId) -> impl Iterator<Item = Halfedge> {
        let mut ring = self.ring(v);
        std::iter::from_fn(move || {
            let h = ring.halfedge();
            ring.next()?;
            (h != Halfedge::NONE).then_some(h)
        })
    }

    /// The halfedge on the other side of `h`, or [`Halfedge::NONE`].
    #[inline]
    pub(crate) fn twin(&self, h: Halfedge) -> Halfedge {
        self.faces[h.face()].twins[h.side()]
    }

    /// The neighbours of `v`, in the order of [`Adjacency::ring`].
    #[inline]
    pub(crate) fn ring(&self, v: VertexId) -> Ring<'_> {
        let first = self.leaving[v];
        Ring { faces: &self.faces, first, at: first, tail: None }
    }

    /// The one-rings of a mesh without removed vertices.
    pub(crate) fn rings(&self) -> Rings {
        Rings::fill(self.on_boundary.clone(), &self.degree, |v, ring| {
            ring.iter_mut().zip(self.ring(v)).for_each(|(to, w)| *to = w);
        })
    }

    /// Whether `a` and `b` are, or may be, neighbours; walks around the one that has fewer.
    #[inline]
    pub(crate) fn has_edge(&self, a: VertexId, b: VertexId) -> bool {
        let (few, other) = if self.degree[a] <= self.degree[b] { (a, b) } else { (b, a) };
        self.degree[few] > MAX_WALK || self.ring(few).any(|w| w == other)
    }

    /// Vector normal to `face` whose length is twice its area, in m^2.
    #[inline]
    pub(crate) fn face_cross(&self, face: FaceId, positions: &IdVec<VertexId, DVec3>) -> DVec3 {
        triangle_cross(self.faces[face].corners.map(|v| positions[v]))
    }

    /// Removes `vertex`, whose neighbours are `ring`: the faces of its `star`, each named by the
    /// halfedge that leaves the vertex, become `triangles` of ring positions, ascending.
    pub(crate) fn replace_star(
        &mut self,
        vertex: VertexId,
        ring: &[VertexId],
        star: &[Halfedge],
        triangles: &[[u8; 3]],
    ) {
        let last = ring.len() - 1;
        // The halfedge across each side of the ring; none beyond the new boundary edge.
        let mut outside = [Halfedge::NONE; MAX_RING];
        for (i, h) in star.iter().enumerate() {
            outside[i] = self.twin(h.next());
            self.alive[h.face()] = i < triangles.len();
        }
        for (h, corners) in star.iter().zip(triangles) {
            let corners = corners.map(|i| ring[usize::from(i)]);
            self.faces[h.face()] = Face { corners, twins: [Halfedge::NONE; 3] };
        }
        for (h, &[i, k, j]) in star.iter().zip(triangles) {
            let face = h.face();
            for (side, from, to) in [(0, i, k), (1, k, j)] {
                let here = Halfedge::new(face, side);
                if to == from + 1 {
                    self.join(here, outside[usize::from(from)]);
                } else if let Some(below) = triangles.iter().position(|t| (t[0], t[2]) == (from, to)) {
                    self.join(here, Halfedge::new(star[below].face(), 2));
                }
            }
            if i == 0 && usize::from(j) == last {
                self.join(Halfedge::new(face, 2), outside[last]);
            }
        }
        self.leaving[vertex] = Halfedge::NONE;
        for &v in ring {
            self.degree[v] -= 1;
        }
        let closing = self.on_boundary[vertex].then_some([0, last]);
        for v in diagonals(triangles, ring.len()).chain(closing).flatten() {
            self.degree[ring[v]] += 1;
        }
    }

    /// Makes `here` and `there` twins.
    fn join(&mut self, here: Halfedge, there: Halfedge) {
        let from = self.origin(here);
        self.faces[here.face()].twins[here.side()] = there;
        if there != Halfedge::NONE {
            self.faces[there.face()].twins[there.side()] = here;
        }
        // A boundary vertex keeps its boundary halfedge, which lies outside the star unless it is `there`.
        if there == Halfedge::NONE || !self.on_boundary[from] {
            self.leaving[from] = here;
        }
    }

    /// Splits the edge of `h` at a new vertex `m`, the last one, and its faces with it: `p q c` with the edge `p q`
    /// becomes `p m c`, and `m q c` is appended.
    pub(crate) fn split(&mut self, h: Halfedge) {
        let twin = self.twin(h);
        let m = self.leaving.push(Halfedge::NONE);
        self.on_boundary.push(twin == Halfedge::NONE);
        self.degree.push(2);
        let halves = [h, twin].map(|side| {
            if side == Halfedge::NONE {
                return [Halfedge::NONE; 2];
            }
            let [p, q, c] = [side, side.next(), side.previous()].map(|side| self.origin(side));
            let [across, back] = [side.next(), side.previous()].map(|side| self.twin(side));
            let (face, twins) = (side.face(), [Halfedge::NONE; 3]);
            self.faces[face] = Face { corners: [p, m, c], twins };
            let added = self.faces.push(Face { corners: [m, q, c], twins });
            self.alive.push(true);
            self.join(Halfedge::new(face, 2), back);
            self.join(Halfedge::new(added, 1), across);
            self.join(Halfedge::new(face, 1), Halfedge::new(added, 2));
            self.degree[c] += 1;
            self.degree[m] += 1;
            [face, added].map(|face| Halfedge::new(face, 0))
        });
        // The halves of the twin run the other way.
        let [[first, second], [third, fourth]] = halves;
        for (here, there) in [(first, fourth), (second, third), (third, second), (fourth, first)] {
            if here != Halfedge::NONE {
                self.join(here, there);
            }
        }
    }

    /// Whether the inner edge of `h` can be flipped: its ends keep enough neighbours, and the new edge joins two
    /// vertices and does not exist. Two faces on the same corners have one apex.
    pub(crate) fn can_flip(&self, h: Halfedge) -> bool {
        let [a, b, c, d] = self.diamond(h);
        c != d && self.degree[a] > 3 && self.degree[b] > 3 && !self.has_edge(c, d)
    }

    /// Turns the inner edge of `h` in its two faces, so that it joins the other two corners.
    pub(crate) fn flip(&mut self, h: Halfedge) {
        let twin = self.twin(h);
        let [a, b, c, d] = self.diamond(h);
        let [bc, ca, ad, db] =
            [h.next(), h.previous(), twin.next(), twin.previous()].map(|side| self.twin(side));
        for (face, corners) in [(h.face(), [c, a, d]), (twin.face(), [d, b, c])] {
            self.faces[face] = Face { corners, twins: [Halfedge::NONE; 3] };
        }
        let [first, second] = [h, twin].map(|h| [0, 1, 2].map(|side| Halfedge::new(h.face(), side)));
        for (here, there) in
            [(first[0], ca), (first[1], ad), (second[0], db), (second[1], bc), (first[2], second[2])]
        {
            self.join(here, there);
        }
        [a, b].into_iter().for_each(|v| self.degree[v] -= 1);
        [c, d].into_iter().for_each(|v| self.degree[v] += 1);
    }

    /// Removes the face of a halfedge on the boundary whose apex is not on it.
    pub(crate) fn remove_face(&mut self, h: Halfedge) {
        let [a, b, c] = [self.origin(h), self.target(h), self.apex(h)];
        for twin in [h.next(), h.previous()].map(|side| self.twin(side)) {
            self.join(twin, Halfedge::NONE);
        }
        [a, b].into_iter().for_each(|v| self.degree[v] -= 1);
        self.on_boundary[c] = true;
        self.alive[h.face()] = false;
    }

    /// Whether the edge of `h` can shrink to its target without changing the topology of the surface; boundary
    /// vertices move along the boundary only.
    pub(crate) fn can_collapse(&self, h: Halfedge) -> bool {
        let (twin, a, b) = (self.twin(h), self.origin(h), self.target(h));
        if twin != Halfedge::NONE && self.on_boundary[a] {
            return false;
        }
        let apexes = [h, twin].map(|side| (side != Halfedge::NONE).then(|| self.apex(side)));
        let is_thin = |v: &VertexId| self.degree[*v] <= if self.on_boundary[*v] { 2 } else { 3 };
        // The corner of a long strip has as many neighbours as the strip has taxels along it.
        let (few, other) = if self.degree[a] <= self.degree[b] { (a, b) } else { (b, a) };
        // Only the apexes may be neighbours of both. A second edge between the ends, as where two faces on the same
        // corners were split, would become a loop.
        !apexes.iter().flatten().any(is_thin)
            && self.ring(few).filter(|&v| v == other).count() == 1
            && self.ring(few).all(|v| v == other || apexes.contains(&Some(v)) || !self.has_edge(v, other))
    }

    /// Shrinks the edge of `h` to its target, where [`HalfedgeMesh::can_collapse`]; its origin is removed.
    pub(crate) fn collapse(&mut self, h: Halfedge) {
        let (twin, a, b) = (self.twin(h), self.origin(h), self.target(h));
        let star: Vec<Halfedge> = self.leaving(a).collect();
        for leaving in star {
            self.faces[leaving.face()].corners[leaving.side()] = b;
        }
        self.leaving[a] = Halfedge::NONE;
        self.degree[b] += self.degree[a];
        self.degree[b] -= 2;
        for side in [h, twin].into_iter().filter(|&side| side != Halfedge::NONE) {
            self.degree[b] -= 1;
            let apex = self.apex(side);
            self.degree[apex] -= 1;
            let [p, q] = [side.next(), side.previous()].map(|side| self.twin(side));
            self.alive[side.face()] = false;
            for (here, there) in [(p, q), (q, p)].into_iter().filter(|(here, _)| *here != Halfedge::NONE) {
                self.join(here, there);
            }
        }
    }

    /// The same mesh without the slots of removed vertices and dead faces; order is kept.
    pub(crate) fn compact(&self) -> Compacted {
        let mut vertices = IdVec::<VertexId, VertexId>::filled(VertexId::default(), self.leaving.len());
        let mut old_vertices = IdVec::default();
        for v in self.leaving.ids().filter(|&v| self.leaving[v] != Halfedge::NONE) {
            vertices[v] = old_vertices.push(v);
        }
        let mut new_faces = IdVec::<FaceId, FaceId>::filled(FaceId::default(), self.faces.len());
        let mut kept = IdVec::<FaceId, FaceId>::default();
        for f in self.faces.ids().filter(|&f| self.alive[f]) {
            new_faces[f] = kept.push(f);
        }
        let rename =
            |h: Halfedge| if h == Halfedge::NONE { h } else { Halfedge::new(new_faces[h.face()], h.side()) };
        let mesh = Self {
            faces: kept.map(|&f| {
                let Face { corners, twins } = self.faces[f];
                Face { corners: corners.map(|v| vertices[v]), twins: twins.map(rename) }
            }),
            alive: IdVec::filled(true, kept.len()),
            leaving: old_vertices.map(|&v| rename(self.leaving[v])),
            on_boundary: old_vertices.map(|&v| self.on_boundary[v]),
            degree: old_vertices.map(|&v| self.degree[v]),
        };
        Compacted { mesh, old_vertices, new_faces }
    }
}

/// Diagonals of a triangulation of `count` ring positions: each is the side from the first to the
/// last corner of exactly one triangle, because corners ascend.
pub(crate) fn diagonals(triangles: &[[u8; 3]], count: usize) -> impl Iterator<Item = [usize; 2]> {
    let ends = triangles.iter().map(|&[i, _, j]| [usize::from(i), usize::from(j)]);
    ends.filter(move |&ends| ends != [0, count - 1])
}

pub(crate) struct Ring<'a> {
    faces: &'a IdVec<FaceId, Face>,
    first: Halfedge,
    at: Halfedge,
    /// The last neighbour of a boundary vertex, which no leaving halfedge reaches.
    tail: Option<VertexId>,
}

impl Ring<'_> {
    /// The halfedge that leads to the neighbour which `next` returns; none before the last one of a
    /// boundary vertex.
    pub(crate) fn halfedge(&self) -> Halfedge {
        self.at
    }
}

impl Iterator for Ring<'_> {
    type Item = VertexId;

    #[inline]
    fn next(&mut self) -> Option<VertexId> {
        if self.at == Halfedge::NONE {
            return self.tail.take();
        }
        let (face, back) = (&self.faces[self.at.face()], self.at.previous().side());
        // The next face counter-clockwise lies across the side that comes back to the vertex.
        let twin = face.twins[back];
        let neighbour = face.corners[self.at.next().side()];
        if twin == Halfedge::NONE {
            self.tail = Some(face.corners[back]);
            self.at = Halfedge::NONE;
        } else {
            self.at = if twin == self.first { Halfedge::NONE } else { twin };
        }
        Some(neighbour)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// The editable mesh, walked, has the rings of the mesh at rest.
    #[test]
    fn rings_are_those_of_the_adjacency() {
        for mesh in [
            shapes::triangle(),
            shapes::fan(5),
            shapes::lattice(7, 6, 1.0),
            shapes::tube(5, 4, 1.0, 2.0),
            shapes::torus(6, 5, 2.0, 0.5),
            shapes::tetrahedron(),
        ] {
            let (halfedges, rings) = HalfedgeMesh::new(&mesh).unwrap();
            assert_eq!(halfedges.rings(), rings);
            assert_eq!(halfedges.triangles(), mesh.triangles);
        }
    }

    /// The mesh has the twins, rings and degrees of one made anew from its faces.
    fn check(mesh: &HalfedgeMesh, name: &str) {
        let left = mesh.compact().mesh;
        let positions = left.leaving.map(|_| DVec3::ZERO);
        let adjacency = Adjacency::new(&TriMesh { positions, triangles: left.triangles() }).unwrap();
        for v in left.leaving.ids() {
            assert_eq!(
                left.ring(v).collect::<Vec<_>>(),
                {
                    let ring = adjacency.ring(v);
                    let start = left.ring(v).next().and_then(|w| ring.iter().position(|&x| x == w)).unwrap();
                    [&ring[start..], &ring[..start]].concat()
                },
                "{name}: ring of {v}"
            );
            assert_eq!(left.degree[v] as usize, adjacency.ring(v).len(), "{name}: degree of {v}");
            assert_eq!(left.on_boundary[v], adjacency.is_boundary(v), "{name}: {v} on the boundary");
        }
        for h in left.halfedges() {
            assert_eq!(left.twin(h), adjacency.twin(h).unwrap_or(Halfedge::NONE), "{name}: twin of {h:?}");
        }
    }

    /// Every edge is split, flipped and collapsed and every face at the rim removed where possible, each
    /// alone and one after the other.
    #[test]
    fn changed_edges_leave_a_manifold() {
        for (name, mesh) in [
            ("triangle", shapes::triangle()),
            // Vertices of degree 3, and of degree 2 at the rim.
            ("fan", shapes::fan(3)),
            ("lattice", shapes::lattice(4, 3, 1.0)),
            ("tube", shapes::tube(5, 3, 1.0, 2.0)),
            ("torus", shapes::torus(5, 4, 2.0, 0.5)),
            ("tetrahedron", shapes::tetrahedron()),
        ] {
            let (whole, _) = HalfedgeMesh::new(&mesh).unwrap();
            let apply = |change: &str, mesh: &mut HalfedgeMesh, h: Halfedge| {
                let is_inner = mesh.twin(h) != Halfedge::NONE;
                match change {
                    "split" if mesh.is_edge(h) => mesh.split(h),
                    "flipped" if mesh.is_edge(h) && is_inner && mesh.can_flip(h) => mesh.flip(h),
                    "removed" if mesh.is_alive(h.face()) && !is_inner && !mesh.on_boundary[mesh.apex(h)] => {
                        mesh.remove_face(h);
                    }
                    "collapsed" if mesh.is_alive(h.face()) && mesh.can_collapse(h) => mesh.collapse(h),
                    _ => {}
                }
            };
            let mut all = whole.clone();
            for change in ["split", "removed", "flipped", "collapsed"] {
                for h in whole.halfedges() {
                    let mut one = whole.clone();
                    apply(change, &mut one, h);
                    check(&one, &format!("{name}, {h:?} {change}"));
                }
                for h in all.halfedges() {
                    apply(change, &mut all, h);
                    check(&all, &format!("{name}, all {change}"));
                }
            }
        }
    }

    /// The middle of a fan is removed: triangles without it replace its star, and adjacency is updated.
    #[test]
    fn a_replaced_star_leaves_a_manifold() {
        let mesh = shapes::fan(5);
        let (mut halfedges, _) = HalfedgeMesh::new(&mesh).unwrap();
        let mut walk = halfedges.ring(VertexId::new(0));
        let (mut ring, mut star) = (Vec::new(), Vec::new());
        loop {
            let h = walk.halfedge();
            let Some(w) = walk.next() else { break };
            ring.push(w);
            star.push(h);
        }
        halfedges.replace_star(VertexId::new(0), &ring, &star, &[[0, 1, 2], [0, 2, 3], [0, 3, 4]]);
        let Compacted { mesh: left, old_vertices, .. } = halfedges.compact();
        let after =
            TriMesh { positions: old_vertices.map(|&v| mesh.positions[v]), triangles: left.triangles() };
        let expected = Adjacency::new(&after).unwrap();
        for v in after.positions.ids() {
            assert_eq!(left.ring(v).collect::<Vec<_>>(), expected.ring(v), "ring of {v}");
            assert_eq!(left.degree[v] as usize, expected.ring(v).len(), "degree of {v}");
        }
        assert!((after.area() - mesh.area()).abs() < 1e-12, "the pentagon is still covered");
    }
}
