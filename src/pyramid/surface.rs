use glam::DVec3;

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{MeshError, TriMesh},
    pyramid::PyramidError,
};

/// Corner after and before corner `k` of a face.
pub(super) const NEXT: [usize; 3] = [1, 2, 0];
pub(super) const PREVIOUS: [usize; 3] = [2, 0, 1];

/// Sides are packed with two bits for the corner, so so many faces can be told apart.
const MAX_FACES: usize = 1 << 30;

/// Two vertices with more neighbours than this are taken for neighbours without looking: between two hubs of a
/// thousand spokes every spoke's removal would ask again.
const MAX_WALK: u32 = 256;

/// One side of a face, from its corner `k` to the next one, in four bytes.
///
/// [`crate::mesh::Halfedge`] is the same thing for meshes that rest; this one is stored twice per edge in a mesh
/// that changes, so it is packed and has a value for "none".
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Side(u32);

impl Side {
    /// No face on the other side, or no side at all.
    pub(super) const NONE: Self = Self(u32::MAX);

    pub(super) fn new(face: FaceId, k: usize) -> Self {
        debug_assert!(k < 3 && face.index() < MAX_FACES, "checked when the surface was made");
        Self(face.raw() << 2 | [0, 1, 2][k])
    }

    #[inline]
    pub(super) fn face(self) -> FaceId {
        FaceId::from(self.0 >> 2)
    }

    #[inline]
    pub(super) const fn k(self) -> usize {
        (self.0 & 3) as usize
    }
}

/// A face with its neighbours: one cache line fetch answers both questions of a walk.
#[derive(Debug, Clone, Copy)]
pub(super) struct Face {
    /// Corners, counter-clockwise seen from outside.
    pub(super) corners: [VertexId; 3],
    /// What lies across the side from corner `k` to the next.
    pub(super) twins: [Side; 3],
}

/// An oriented manifold that changes: halfedges on flat arrays.
///
/// Removing a vertex reuses the slots of its star, so nothing is allocated and vertex ids stay; slots that are left
/// over are marked dead and squeezed out by [`Surface::compact`].
#[derive(Debug, Clone)]
pub(super) struct Surface {
    pub(super) faces: IdVec<FaceId, Face>,
    pub(super) alive: IdVec<FaceId, bool>,
    /// A side that leaves each vertex: the boundary's where there is one, none for a removed vertex.
    pub(super) leaving: IdVec<VertexId, Side>,
    pub(super) on_boundary: IdVec<VertexId, bool>,
    pub(super) degree: IdVec<VertexId, u32>,
}

/// New ids of what is left after [`Surface::compact`].
pub(super) struct Compacted {
    pub(super) surface: Surface,
    /// The old id of every vertex.
    pub(super) parents: IdVec<VertexId, VertexId>,
    /// The new id of every old face; meaningless for dead ones.
    pub(super) faces: IdVec<FaceId, FaceId>,
}

impl Surface {
    /// The surface of a mesh.
    ///
    /// # Errors
    /// If the mesh is no oriented manifold or has too many faces.
    pub(super) fn new(mesh: &TriMesh) -> Result<Self, PyramidError> {
        mesh.validate()?;
        if mesh.triangles.len() >= MAX_FACES {
            return Err(PyramidError::TooManyFaces { found: mesh.triangles.len(), most: MAX_FACES });
        }
        let mut faces: IdVec<FaceId, Face> =
            mesh.triangles.map(|&corners| Face { corners, twins: [Side::NONE; 3] });
        let vertices = mesh.positions.len();
        pair(vertices, &mut faces)?;
        let mut leaving = IdVec::filled(Side::NONE, vertices);
        // Faces and boundary sides that leave each vertex: together what one fan has neighbours.
        let mut fans = IdVec::<VertexId, (u32, u32)>::filled((0, 0), vertices);
        for (id, face) in faces.enumerate() {
            for (k, &v) in face.corners.iter().enumerate() {
                let opens = face.twins[k] == Side::NONE;
                if opens || leaving[v] == Side::NONE {
                    leaving[v] = Side::new(id, k);
                }
                fans[v].0 += 1;
                fans[v].1 += u32::from(opens);
            }
        }
        let alive = IdVec::filled(true, faces.len());
        let on_boundary = fans.map(|&(_, opens)| opens > 0);
        let degree = fans.map(|&(size, opens)| size + opens);
        let surface = Self { faces, alive, leaving, on_boundary, degree };
        for (vertex, &(size, opens)) in fans.enumerate() {
            if size == 0 {
                return Err(MeshError::IsolatedVertex { vertex }.into());
            }
            if opens > 1 || surface.ring(vertex).count() != surface.degree[vertex] as usize {
                let fans = if opens > 1 { opens as usize } else { 2 };
                return Err(MeshError::NonManifoldVertex { vertex, fans }.into());
            }
        }
        Ok(surface)
    }

    /// The neighbours of `v`, counter-clockwise; on a boundary from the next to the previous vertex of its loop.
    #[inline]
    pub(super) fn ring(&self, v: VertexId) -> Ring<'_> {
        let first = self.leaving[v];
        Ring { faces: &self.faces, first, at: first, tail: None }
    }

    /// Whether `a` and `b` are, or may be, neighbours; walks around the one that has fewer.
    pub(super) fn has_edge(&self, a: VertexId, b: VertexId) -> bool {
        let (few, other) = if self.degree[a] <= self.degree[b] { (a, b) } else { (b, a) };
        self.degree[few] > MAX_WALK || self.ring(few).any(|w| w == other)
    }

    /// Vector normal to `face` whose length is twice its area, in m^2.
    pub(super) fn face_cross(&self, face: FaceId, positions: &IdVec<VertexId, DVec3>) -> DVec3 {
        let [a, b, c] = self.faces[face].corners.map(|v| positions[v]);
        (b - a).cross(c - a)
    }

    /// The boundary loops, each from its smallest vertex, faces on the left.
    pub(super) fn boundary_loops(&self) -> Vec<Vec<VertexId>> {
        let mut seen = IdVec::<VertexId, bool>::filled(false, self.leaving.len());
        let mut loops = Vec::new();
        for start in self.leaving.ids().filter(|&v| self.on_boundary[v]) {
            let mut walk = Vec::new();
            let mut at = start;
            while !seen[at] {
                seen[at] = true;
                walk.push(at);
                let Some(next) = self.ring(at).next() else { break };
                at = next;
            }
            if !walk.is_empty() {
                loops.push(walk);
            }
        }
        loops
    }

    /// The same surface without the slots of removed vertices and dead faces; order is kept.
    pub(super) fn compact(&self) -> Compacted {
        let mut vertices = IdVec::<VertexId, VertexId>::filled(VertexId::default(), self.leaving.len());
        let mut parents = IdVec::new();
        for v in self.leaving.ids().filter(|&v| self.leaving[v] != Side::NONE) {
            vertices[v] = parents.push(v);
        }
        let mut faces = IdVec::<FaceId, FaceId>::filled(FaceId::default(), self.faces.len());
        let mut kept = IdVec::<FaceId, FaceId>::new();
        for f in self.faces.ids().filter(|&f| self.alive[f]) {
            faces[f] = kept.push(f);
        }
        let rename = |s: Side| if s == Side::NONE { s } else { Side::new(faces[s.face()], s.k()) };
        let surface = Self {
            faces: kept.map(|&f| {
                let Face { corners, twins } = self.faces[f];
                Face { corners: corners.map(|v| vertices[v]), twins: twins.map(rename) }
            }),
            alive: IdVec::filled(true, kept.len()),
            leaving: parents.map(|&v| rename(self.leaving[v])),
            on_boundary: parents.map(|&v| self.on_boundary[v]),
            degree: parents.map(|&v| self.degree[v]),
        };
        Compacted { surface, parents, faces }
    }
}

/// Finds the twin of every side: sides are sorted by their smaller end, and within one bucket by the larger.
fn pair(vertices: usize, faces: &mut IdVec<FaceId, Face>) -> Result<(), MeshError> {
    let ends = |face: &Face, k: usize| {
        let (a, b) = (face.corners[k], face.corners[NEXT[k]]);
        (a.min(b), a.max(b), a < b)
    };
    let mut starts = vec![0_usize; vertices + 1];
    for face in &*faces {
        for k in 0..3 {
            starts[ends(face, k).0.index() + 1] += 1;
        }
    }
    for i in 0..vertices {
        starts[i + 1] += starts[i];
    }
    let mut cursor = starts.clone();
    let mut sorted = vec![(VertexId::default(), false, Side::NONE); 3 * faces.len()];
    for (id, face) in faces.enumerate() {
        for k in 0..3 {
            let (low, high, up) = ends(face, k);
            sorted[cursor[low.index()]] = (high, up, Side::new(id, k));
            cursor[low.index()] += 1;
        }
    }
    for bounds in starts.windows(2) {
        let bucket = &mut sorted[bounds[0]..bounds[1]];
        bucket.sort_unstable_by_key(|&(high, up, side)| (high, up, side.0));
        for edge in bucket.chunk_by(|a, b| a.0 == b.0) {
            match *edge {
                [_] => {}
                [(_, false, a), (_, true, b)] => {
                    faces[a.face()].twins[a.k()] = b;
                    faces[b.face()].twins[b.k()] = a;
                }
                _ => return Err(overfull(faces, edge)),
            }
        }
    }
    Ok(())
}

/// The error of an edge with two sides that run the same way; of three sides two do.
fn overfull(faces: &IdVec<FaceId, Face>, edge: &[(VertexId, bool, Side)]) -> MeshError {
    let same = edge.windows(2).position(|pair| pair[0].1 == pair[1].1).unwrap_or(0);
    let (first, second) = (edge[same].2, edge[same + 1].2);
    let corners = faces[first.face()].corners;
    let (from, to) = (corners[first.k()], corners[NEXT[first.k()]]);
    MeshError::NonManifoldEdge { from, to, first: first.face(), second: second.face() }
}

/// Walks around a vertex; see [`Surface::ring`].
pub(super) struct Ring<'a> {
    faces: &'a IdVec<FaceId, Face>,
    first: Side,
    at: Side,
    /// The last neighbour of a boundary vertex, which no leaving side reaches.
    tail: Option<VertexId>,
}

impl Ring<'_> {
    /// The side that leads to the neighbour which `next` returns; none before the last one of a boundary vertex.
    pub(super) fn side(&self) -> Side {
        self.at
    }
}

impl Iterator for Ring<'_> {
    type Item = VertexId;

    #[inline]
    fn next(&mut self) -> Option<VertexId> {
        if self.at == Side::NONE {
            return self.tail.take();
        }
        let (face, k) = (&self.faces[self.at.face()], self.at.k());
        // The next face counter-clockwise lies across the side that comes back to the vertex.
        let twin = face.twins[PREVIOUS[k]];
        if twin == Side::NONE {
            self.tail = Some(face.corners[PREVIOUS[k]]);
            self.at = Side::NONE;
        } else {
            self.at = if twin == self.first { Side::NONE } else { twin };
        }
        Some(face.corners[NEXT[k]])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::mesh::{Adjacency, shapes};

    /// Both find the same neighbours; only the start of a closed ring is free.
    fn assert_agrees(mesh: &TriMesh) {
        let (surface, adjacency) = (Surface::new(mesh).unwrap(), Adjacency::new(mesh).unwrap());
        for v in mesh.positions.ids() {
            let ring: Vec<_> = surface.ring(v).collect();
            assert_eq!(surface.on_boundary[v], adjacency.is_boundary(v), "boundary at {v}");
            assert_eq!(surface.degree[v] as usize, ring.len(), "degree of {v}");
            let mut expected = adjacency.ring(v).to_vec();
            if !adjacency.is_boundary(v) {
                let start = expected.iter().position(|w| *w == ring[0]).unwrap();
                expected.rotate_left(start);
            }
            assert_eq!(ring, expected, "ring of {v}");
        }
        assert_eq!(surface.boundary_loops(), adjacency.boundary_loops());
    }

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
            assert_agrees(&mesh);
        }
    }

    proptest! {
        /// On heaps of triangles both see a manifold, or both see none.
        #[test]
        fn manifolds_are_those_of_the_adjacency(
            corners in prop::collection::vec((0_u32..6, 0_u32..6, 0_u32..6), 1..9),
        ) {
            let triangles: Vec<_> = corners.into_iter().map(|(a, b, c)| [a, b, c]).collect();
            let used = triangles.iter().flatten().max().map_or(0, |v| v + 1);
            let positions = (0..used).map(|v| DVec3::splat(f64::from(v))).collect();
            let mesh = TriMesh::from_arrays(positions, &triangles);
            match (Surface::new(&mesh), Adjacency::new(&mesh)) {
                (Ok(_), Ok(_)) => assert_agrees(&mesh),
                (Err(PyramidError::Mesh(found)), Err(expected)) => {
                    let kind = |e: &MeshError| match e {
                        // Which is found first where there are both is nobody's business.
                        MeshError::NonManifoldVertex { .. } | MeshError::IsolatedVertex { .. } => "vertex",
                        MeshError::NonManifoldEdge { .. } => "edge",
                        _ => "corner",
                    };
                    prop_assert_eq!(kind(&found), kind(&expected));
                }
                (found, expected) => prop_assert!(false, "{:?}, but {:?}", found, expected),
            }
        }
    }
}
