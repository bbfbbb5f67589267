//! Closes small holes with triangles of least area.

use glam::DVec3;

use crate::{
    id::VertexId,
    mesh::{Adjacency, MeshError, TriMesh},
};

/// Closes every hole whose boundary loop has at most `max_edges` edges, with triangles between its
/// own vertices.
///
/// Each hole gets its triangulation of least area (barequet1995), without edges that
/// the mesh already has; a hole that has none stays open. The longest loop is the outer boundary
/// and is never closed. Returns the loops closed. Time grows with the cube of `max_edges` per hole.
///
/// # Errors
/// If the mesh is not an oriented manifold.
pub fn fill_holes(mesh: &mut TriMesh, max_edges: usize) -> Result<Vec<Vec<VertexId>>, MeshError> {
    let adjacency = Adjacency::new(mesh)?;
    let mut loops = adjacency.boundary_loops();
    let length = |walk: &[VertexId]| -> f64 {
        let next = walk.iter().cycle().skip(1);
        walk.iter().zip(next).map(|(&a, &b)| mesh.positions[a].distance(mesh.positions[b])).sum()
    };
    let outer =
        (0..loops.len()).max_by(|&i, &j| length(&loops[i]).total_cmp(&length(&loops[j])).then(j.cmp(&i)));
    if let Some(outer) = outer {
        loops.remove(outer);
    }
    loops.retain(|walk| walk.len() <= max_edges);
    let fills: Vec<_> = loops.iter().map(|walk| least_area(mesh, &adjacency, walk)).collect();
    let mut closed = Vec::new();
    for (walk, fill) in loops.into_iter().zip(fills) {
        if let Some(fill) = fill {
            fill.into_iter().for_each(|t| {
                mesh.triangles.push(t);
            });
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::shapes;

    /// A lattice with the star of one inner vertex cut out: a hole of six edges.
    fn lattice_with_a_hole() -> TriMesh {
        let mut mesh = shapes::lattice(7, 7, 0.01);
        let gone = VertexId::new(24);
        mesh.triangles = mesh.triangles.into_iter().filter(|t| !t.contains(&gone)).collect();
        let keep = |v: VertexId| if v > gone { VertexId::new(v.index() - 1) } else { v };
        mesh.triangles = mesh.triangles.map(|t| t.map(keep));
        mesh.positions = mesh.positions.enumerate().filter(|(v, _)| *v != gone).map(|(_, &p)| p).collect();
        mesh
    }

    #[test]
    fn a_filled_hole_makes_the_flat_sheet_whole() {
        let mut mesh = lattice_with_a_hole();
        let area = shapes::lattice(7, 7, 0.01).area();
        let closed = fill_holes(&mut mesh, 6).unwrap();
        assert_eq!(closed.len(), 1, "one hole");
        assert_eq!(Adjacency::new(&mesh).unwrap().boundary_loops().len(), 1, "the outer boundary stays");
        assert!((mesh.area() - area).abs() < 1e-12, "a flat hole has one least area: its own");
        let up = mesh.triangles.ids().all(|f| mesh.face_cross(f).z > 0.0);
        assert!(up, "the filling faces outward like the rest");
    }

    #[test]
    fn a_hole_with_more_edges_stays_open() {
        let mut mesh = lattice_with_a_hole();
        let before = mesh.clone();
        assert!(fill_holes(&mut mesh, 5).unwrap().is_empty());
        assert_eq!(mesh, before);
    }
}
