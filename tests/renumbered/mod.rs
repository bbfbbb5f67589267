//! The same surface with its vertices in another order, for the tests and benches that ask whether
//! the order matters.

use dermatome::{id::VertexId, mesh::TriMesh};

/// Vertex `v` becomes `order[v]`, a permutation.
pub(crate) fn renumbered(mesh: &TriMesh, order: &[usize]) -> TriMesh {
    let to = |v: VertexId| VertexId::new(order[v.index()]);
    let mut out = mesh.clone();
    for (v, &p) in mesh.positions.enumerate() {
        out.positions[to(v)] = p;
    }
    out.triangles = mesh.triangles.map(|corners| corners.map(to));
    out
}
