//! The parts of a mesh that hang together, and each of them as a mesh of its own.

use crate::{
    id::{IdVec, VertexId},
    mesh::TriMesh,
    numeric::DisjointSets,
};

/// Which part each vertex of a mesh belongs to.
#[derive(Debug, Clone)]
pub(crate) struct Parts {
    /// The part of each vertex.
    pub(crate) of: IdVec<VertexId, usize>,
    /// The vertices of each part, ascending.
    pub(crate) vertices: Vec<IdVec<VertexId, VertexId>>,
    /// The number of each vertex in its part.
    pub(crate) number: IdVec<VertexId, VertexId>,
}

impl Parts {
    /// `count` parts; vertices that share a face must be in one.
    pub(crate) fn new(of: IdVec<VertexId, usize>, count: usize) -> Self {
        let mut vertices = vec![IdVec::default(); count];
        let number = of.enumerate().map(|(v, &part)| vertices[part].push(v)).collect();
        Self { of, vertices, number }
    }

    /// The components of a mesh, numbered by their smallest vertices; vertices without a face belong to
    /// the first one.
    pub(crate) fn of_components(mesh: &TriMesh) -> Self {
        let count = mesh.positions.len();
        let mut sets = DisjointSets::<VertexId>::new(count);
        let mut is_used = IdVec::<VertexId, bool>::filled(false, count);
        for &[a, b, c] in &mesh.triangles {
            sets.join(a, b);
            sets.join(b, c);
            [a, b, c].iter().for_each(|&v| is_used[v] = true);
        }
        let mut parts = 0;
        let mut of = IdVec::<VertexId, usize>::filled(0, count);
        for v in mesh.positions.ids().filter(|&v| is_used[v]) {
            let root = sets.root(v);
            of[v] = if root == v { parts } else { of[root] };
            parts += usize::from(root == v);
        }
        Self::new(of, parts.max(1))
    }

    pub(crate) fn len(&self) -> usize {
        self.vertices.len()
    }

    /// The parts of the mesh, each with its faces in their order.
    pub(crate) fn meshes(&self, mesh: &TriMesh) -> Vec<TriMesh> {
        let part = |vertices: &IdVec<VertexId, VertexId>| TriMesh {
            positions: vertices.map(|&v| mesh.positions[v]),
            triangles: IdVec::default(),
        };
        let mut meshes: Vec<TriMesh> = self.vertices.iter().map(part).collect();
        for corners in &mesh.triangles {
            meshes[self.of[corners[0]]].triangles.push(corners.map(|v| self.number[v]));
        }
        meshes
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    #[test]
    fn a_mesh_of_two_parts_is_both_of_them() {
        let (square, fan) = (shapes::square(), shapes::fan(5));
        let mut both = square.clone();
        let count = both.positions.len();
        fan.positions.iter().for_each(|&p| {
            both.positions.push(p);
        });
        for corners in &fan.triangles {
            both.triangles.push(corners.map(|v| VertexId::new(v.index() + count)));
        }
        let parts = Parts::of_components(&both);
        assert_eq!(parts.meshes(&both), [square, fan]);
    }
}
