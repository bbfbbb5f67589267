//! Angles, cotangents and lengths of triangles.

use glam::DVec3;

use crate::mesh::{Adjacency, TriMesh};

/// Angle at `at` in the triangle `at`, `b`, `c`, in rad; accurate for slivers too.
#[must_use]
pub fn angle(at: DVec3, b: DVec3, c: DVec3) -> f64 {
    let (u, v) = (b - at, c - at);
    u.cross(v).length().atan2(u.dot(v))
}

/// Cotangent of the angle at `at` in the triangle `at`, `b`, `c`; infinite for a zero angle.
#[must_use]
pub(crate) fn cotangent(at: DVec3, b: DVec3, c: DVec3) -> f64 {
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
