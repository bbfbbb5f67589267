//! Components, boundary loops and the Euler characteristic: the topology of a surface; and each component as
//! a mesh of its own.

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::connectivity::edges::Edges;
use crate::mesh::{Halfedge, TriMesh};
use crate::numeric::{DisjointSets, Labels};

/// The component of each face; faces are joined at their corners. Components are numbered in the order of
/// their smallest vertices.
pub(crate) fn face_components(triangles: &IdVec<FaceId, [VertexId; 3]>, vertices: usize) -> Labels<FaceId> {
    let mut sets = DisjointSets::<VertexId>::new(vertices);
    let mut is_used = IdVec::<VertexId, bool>::filled(false, vertices);
    for &[a, b, c] in triangles {
        sets.join(a, b);
        sets.join(b, c);
        [a, b, c].iter().for_each(|&v| is_used[v] = true);
    }
    let (mut number, mut count) = (IdVec::<VertexId, usize>::filled(0, vertices), 0);
    for v in is_used.ids().filter(|&v| is_used[v] && sets.root(v) == v) {
        number[v] = count;
        count += 1;
    }
    Labels { of: triangles.map(|t| number[sets.root(t[0])]), count }
}

/// The corners of faces, by the halfedges that leave them, in sets that are one vertex. `across` leads from a halfedge to
/// its twin, or nowhere where the surface ends.
pub(crate) fn joined_corners(
    faces: usize,
    across: impl Fn(Halfedge) -> Option<Halfedge>,
) -> DisjointSets<Halfedge> {
    let mut corners = DisjointSets::<Halfedge>::new(4 * faces);
    for h in (0..faces).flat_map(|face| Halfedge::of_face(FaceId::new(face))) {
        if let Some(twin) = across(h) {
            corners.join(h, twin.next());
            corners.join(h.next(), twin);
        }
    }
    corners
}

/// Some faces of a mesh as a mesh of their own.
#[derive(Debug, Clone, Default)]
pub(crate) struct Part {
    /// For each vertex its id in the whole mesh, ascending.
    pub(crate) vertices: IdVec<VertexId, VertexId>,
    pub(crate) mesh: TriMesh,
}

/// Separates a mesh into `count` meshes that share no vertex. `part` gives the index of the mesh of each
/// face; faces without one are left out.
pub(crate) fn separate(mesh: &TriMesh, part: &IdVec<FaceId, Option<usize>>, count: usize) -> Vec<Part> {
    let mut of_vertex = IdVec::<VertexId, Option<usize>>::filled(None, mesh.positions.len());
    for (face, t) in mesh.triangles.enumerate().filter(|(face, _)| part[*face].is_some()) {
        t.iter().for_each(|&v| of_vertex[v] = part[face]);
    }
    let mut parts = vec![Part::default(); count];
    let mut number = IdVec::<VertexId, VertexId>::filled(VertexId::default(), mesh.positions.len());
    for (v, part) in of_vertex.enumerate() {
        if let Some(part) = part.map(|part| &mut parts[part]) {
            part.vertices.push(v);
            number[v] = part.mesh.positions.push(mesh.positions[v]);
        }
    }
    for (face, t) in mesh.triangles.enumerate() {
        if let Some(part) = part[face] {
            parts[part].mesh.triangles.push(t.map(|v| number[v]));
        }
    }
    parts
}

/// Numbers that differ for surfaces that cannot be deformed into each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Topology {
    pub(crate) components: usize,
    pub(crate) loops: usize,
    /// Vertices minus edges plus faces.
    pub(crate) euler: i64,
}

impl Topology {
    /// The topology of each component of `triangles`, whose faces may have any winding; each vertex must
    /// have one fan of faces. `edges` are those of the triangles, `components` the component of each face.
    pub(crate) fn of_components(
        triangles: &IdVec<FaceId, [VertexId; 3]>,
        edges: &Edges,
        components: &Labels<FaceId>,
        vertices: usize,
    ) -> Vec<Self> {
        let mut topologies = vec![Self { components: 1, loops: 0, euler: 0 }; components.count];
        let mut is_seen = IdVec::<VertexId, bool>::filled(false, vertices);
        for (face, t) in triangles.enumerate() {
            let new: i64 = t.iter().map(|&v| i64::from(!std::mem::replace(&mut is_seen[v], true))).sum();
            topologies[components.of[face]].euler += new + 1;
        }
        // The loops are the sets of vertices along edges of one face.
        let mut rims = DisjointSets::<VertexId>::new(vertices);
        let mut on_rim = Vec::new();
        let start = |h: Halfedge| triangles[h.face()][h.side()];
        for uses in edges.iter() {
            let component = components.of[uses[0].face()];
            topologies[component].euler -= 1;
            if let &[h] = uses {
                rims.join(start(h), start(h.next()));
                on_rim.push((start(h), component));
            }
        }
        let mut is_counted = IdVec::<VertexId, bool>::filled(false, vertices);
        for (v, component) in on_rim {
            let is_new = !std::mem::replace(&mut is_counted[rims.root(v)], true);
            topologies[component].loops += usize::from(is_new);
        }
        topologies
    }

    /// Whether it is one disk, with holes or without: it has a boundary and no handle.
    pub(crate) fn is_disk(&self) -> bool {
        self.components == 1 && self.loops > 0 && self.twice_handles() == 0
    }

    /// Twice the number of handles, by Euler's formula `V - E + F = 2 - 2 handles - loops` of each
    /// component; a surface with one side may have an odd number.
    pub(crate) fn twice_handles(&self) -> i64 {
        let count = |n: usize| i64::try_from(n).expect("counts fit into 63 bits");
        2 * count(self.components) - count(self.loops) - self.euler
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Adjacency, shapes};

    #[test]
    fn the_topology_of_two_components_is_that_of_each() {
        let (square, fan) = (shapes::square(), shapes::fan(5));
        let mut both = square.clone();
        // A vertex without a face between them.
        both.positions.push(glam::DVec3::ONE);
        let count = both.positions.len();
        for &p in &fan.positions {
            both.positions.push(p);
        }
        for corners in &fan.triangles {
            both.triangles.push(corners.map(|v| VertexId::new(v.index() + count)));
        }
        let components = face_components(&both.triangles, both.positions.len());
        assert_eq!(components.count, 2);
        let parts = separate(&both, &components.of.map(|&c| Some(c)), 2);
        assert!(parts.iter().map(|part| &part.mesh).eq([&square, &fan]));
        assert_eq!(parts[1].vertices[VertexId::new(0)].index(), count);
    }

    #[test]
    fn the_topology_does_not_depend_on_the_winding() {
        for mesh in [shapes::fan(5), shapes::tube(5, 4, 1.0, 2.0), shapes::torus(8, 6, 2.0, 0.5)] {
            let expected = Adjacency::new(&mesh).unwrap().topology();
            let TriMesh { positions, mut triangles } = mesh;
            triangles.iter_mut().step_by(3).for_each(|t| t.swap(0, 1));
            let edges = Edges::new(&triangles, positions.len());
            let components = face_components(&triangles, positions.len());
            let found = Topology::of_components(&triangles, &edges, &components, positions.len());
            assert_eq!(found, [expected]);
        }
    }

    #[test]
    fn a_disk_has_a_boundary_and_no_handle() {
        let of = |mesh: &TriMesh| Adjacency::new(mesh).unwrap().topology();
        assert!(of(&shapes::fan(5)).is_disk());
        assert!(of(&shapes::tube(5, 4, 1.0, 2.0)).is_disk(), "a disk with a hole");
        let torus = of(&shapes::torus(8, 6, 2.0, 0.5));
        assert_eq!((torus.is_disk(), torus.twice_handles()), (false, 2));
    }
}
