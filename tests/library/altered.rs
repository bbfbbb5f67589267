//! Meshes made of others, for tests and benches.
#![allow(dead_code, reason = "each program uses a part of it")]

use dermatome::id::{FaceId, IdVec, VertexId};
use dermatome::mesh::TriMesh;

/// The same surface with its vertices in another order: vertex `v` becomes `order[v]`, a permutation.
pub(crate) fn renumbered(mesh: &TriMesh, order: &[usize]) -> TriMesh {
    let to = |v: VertexId| VertexId::new(order[v.index()]);
    let mut out = mesh.clone();
    for (v, &p) in mesh.positions.enumerate() {
        out.positions[to(v)] = p;
    }
    out.triangles = mesh.triangles.map(|corners| corners.map(to));
    out
}

/// A mesh without some of its faces, and without the vertices of these alone.
pub(crate) fn without(mesh: &TriMesh, is_removed: impl Fn(FaceId) -> bool) -> TriMesh {
    let mut number = IdVec::<VertexId, Option<VertexId>>::from(vec![None; mesh.positions.len()]);
    let mut out = TriMesh::default();
    for face in mesh.triangles.ids().filter(|&face| !is_removed(face)) {
        let corners = mesh.triangles[face];
        let kept = corners.map(|v| *number[v].get_or_insert_with(|| out.positions.push(mesh.positions[v])));
        out.triangles.push(kept);
    }
    out
}
