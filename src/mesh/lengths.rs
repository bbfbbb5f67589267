use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    mesh::{Adjacency, TriMesh},
};

/// Angle at `at` in the triangle `at`, `b`, `c`, in rad; accurate for slivers too.
#[must_use]
pub fn angle(at: DVec3, b: DVec3, c: DVec3) -> f64 {
    let (u, v) = (b - at, c - at);
    u.cross(v).length().atan2(u.dot(v))
}

/// Cotangent of the angle at `at` in the triangle `at`, `b`, `c`; infinite for a zero angle.
#[must_use]
pub fn cotangent(at: DVec3, b: DVec3, c: DVec3) -> f64 {
    let (u, v) = (b - at, c - at);
    u.dot(v) / u.cross(v).length()
}

/// Mean length of all edges, in m; zero without edges.
#[must_use]
pub fn mean_edge_length(mesh: &TriMesh, adjacency: &Adjacency) -> f64 {
    let (mut sum, mut count) = (0.0, 0_usize);
    for v in mesh.positions.ids() {
        for &w in adjacency.ring(v) {
            if v < w {
                sum += mesh.positions[v].distance(mesh.positions[w]);
                count += 1;
            }
        }
    }
    if count == 0 { 0.0 } else { sum / count as f64 }
}

/// Mean distance of each vertex to its one-ring, in m; zero for a vertex without neighbours.
#[must_use]
pub fn local_spacing(mesh: &TriMesh, adjacency: &Adjacency) -> IdVec<VertexId, f64> {
    mesh.positions
        .enumerate()
        .map(|(v, &p)| {
            let ring = adjacency.ring(v);
            let sum: f64 = ring.iter().map(|&w| p.distance(mesh.positions[w])).sum();
            sum / ring.len().max(1) as f64
        })
        .collect()
}
