//! Closes small holes with triangles of least area.

use glam::DVec3;

use crate::{
    id::VertexId,
    mesh::{Adjacency, MeshError, TriMesh, loop_length},
};

/// A loop is no outer boundary if its squared length is below this share of the area: a disk has at
/// least 12.6 times its area, the open end of a finger ten times as long as it is thick 0.3 times.
const NEARLY_CLOSED: f64 = 0.1;

/// Closes every hole whose boundary loop has at most `max_edges` edges, with triangles between its
/// own vertices.
///
/// Each hole gets its triangulation of least area (barequet1995), without edges that
/// the mesh already has; a hole that has none stays open. The longest loop is the outer boundary
/// and stays, unless the surface is closed but for it. Returns the loops closed. Time grows with the cube of `max_edges` per hole.
///
/// # Errors
/// If the mesh is not an oriented manifold.
pub(crate) fn fill_holes(mesh: &mut TriMesh, max_edges: usize) -> Result<Vec<Vec<VertexId>>, MeshError> {
    let adjacency = Adjacency::new(mesh)?;
    let mut loops = adjacency.boundary_loops();
    let length = |i: usize| loop_length(mesh, &loops[i]);
    let outer = (0..loops.len()).max_by(|&i, &j| length(i).total_cmp(&length(j)).then(j.cmp(&i)));
    if let Some(outer) = outer.filter(|&i| length(i).powi(2) >= NEARLY_CLOSED * mesh.area()) {
        loops.remove(outer);
    }
    loops.retain(|walk| walk.len() <= max_edges);
    let fills: Vec<_> = loops.iter().map(|walk| least_area(mesh, &adjacency, walk)).collect();
    let mut closed = Vec::new();
    for (walk, fill) in loops.into_iter().zip(fills) {
        if let Some(fill) = fill {
            for t in fill {
                mesh.triangles.push(t);
            }
            closed.push(walk);
        }
    }
    Ok(closed)
}

/// The triangles of least total area that close a loop; `None` if each needs an edge the mesh
/// already has.
fn least_area(mesh: &TriMesh, adjacency: &Adjacency, walk: &[VertexId]) -> Option<Vec<[VertexId; 3]>> {
    // The mesh lies left of the loop, so the hole is walked the other way round.
    let rim: Vec<VertexId> = walk.iter().rev().copied().collect();
    let n = rim.len();
    let at = |i: usize| -> DVec3 { mesh.positions[rim[i]] };
    let is_free = |i: usize, j: usize| {
        j == i + 1 || (i == 0 && j == n - 1) || !adjacency.ring(rim[i]).contains(&rim[j])
    };
    let mut cost = vec![f64::INFINITY; n * n];
    let mut apex = vec![usize::MAX; n * n];
    for i in 0..n - 1 {
        cost[i * n + i + 1] = 0.0;
    }
    for span in 2..n {
        for i in 0..n - span {
            let j = i + span;
            if !is_free(i, j) {
                continue;
            }
            for k in i + 1..j {
                let area = 0.5 * (at(k) - at(i)).cross(at(j) - at(i)).length();
                let total = cost[i * n + k] + cost[k * n + j] + area;
                if total < cost[i * n + j] {
                    (cost[i * n + j], apex[i * n + j]) = (total, k);
                }
            }
        }
    }
    if !cost[n - 1].is_finite() {
        return None;
    }
    let mut triangles = Vec::with_capacity(n - 2);
    let mut spans = vec![(0, n - 1)];
    while let Some((i, j)) = spans.pop() {
        if j > i + 1 {
            let k = apex[i * n + j];
            triangles.push([rim[i], rim[k], rim[j]]);
            spans.extend([(i, k), (k, j)]);
        }
    }
    Some(triangles)
}
