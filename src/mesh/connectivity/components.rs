//! The components of a mesh, and each of them as a mesh of its own.

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::TriMesh,
    numeric::{DisjointSets, Labels},
};

/// The component of each face, joined to others at its corners; numbered by the smallest vertices of the
/// components.
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

/// Some faces of a mesh as a mesh of their own.
#[derive(Debug, Clone, Default)]
pub(crate) struct Part {
    /// The vertex of the whole mesh that each vertex is, ascending.
    pub(crate) vertices: IdVec<VertexId, VertexId>,
    pub(crate) mesh: TriMesh,
}

/// Separates a mesh into `count` parts that share no vertex. `part` gives that of each face; faces without
/// one are left out.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_mesh_of_two_components_is_both_of_them() {
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
}
