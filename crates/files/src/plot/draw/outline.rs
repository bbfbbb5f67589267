//! Borders of groups of cells, and the boundary of a mesh, as loops.

use glam::DVec2;

use crate::id::{IdVec, VertexId};
use crate::mesh::{TriMesh, boundary_edges};

/// A point of the cells' borders: a vertex, the midpoint of an edge or the centroid of a face.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Node {
    Vertex(VertexId),
    Middle(VertexId, VertexId),
    Centroid([VertexId; 3]),
}

impl Node {
    fn middle(a: VertexId, b: VertexId) -> Self {
        Self::Middle(a.min(b), a.max(b))
    }

    fn at(self, uv: &IdVec<VertexId, DVec2>) -> DVec2 {
        match self {
            Self::Vertex(v) => uv[v],
            Self::Middle(a, b) => 0.5 * (uv[a] + uv[b]),
            Self::Centroid(t) => t.iter().map(|&v| uv[v]).sum::<DVec2>() / 3.0,
        }
    }
}

/// One loop around cells of a group.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Outline {
    pub(crate) group: u32,
    /// Its corners on the map, in m; the group lies on the left.
    pub(crate) corners: Vec<DVec2>,
}

/// The borders of groups of cells, merged. The cell of a vertex is its barycentric dual: a third of each face
/// around it, bounded by midpoints of edges and centroids.
///
/// The mesh is an oriented manifold; else a loop may stay open, which is harmless in a picture.
pub(crate) fn outlines(
    mesh: &TriMesh,
    uv: &IdVec<VertexId, DVec2>,
    groups: &IdVec<VertexId, u32>,
) -> Vec<Outline> {
    let mut steps = border_steps(mesh, groups);
    steps.sort_unstable();
    let mut used = vec![false; steps.len()];
    let mut out = Vec::new();
    for first in 0..steps.len() {
        if used[first] {
            continue;
        }
        let (group, mut corners, mut at) = (steps[first].0, Vec::new(), first);
        while !used[at] {
            used[at] = true;
            let (_, from, to) = steps[at];
            corners.push(from.at(uv));
            // The group's border continues at the end of this step.
            let next = steps.partition_point(|&(g, from, _)| (g, from) < (group, to));
            match steps.get(next) {
                Some(&(g, from, _)) if (g, from) == (group, to) => at = next,
                _ => break,
            }
        }
        out.push(Outline { group, corners });
    }
    out
}

/// Every piece of border as (group on its left, start, end).
fn border_steps(mesh: &TriMesh, groups: &IdVec<VertexId, u32>) -> Vec<(u32, Node, Node)> {
    let mut steps = Vec::new();
    for &t in &mesh.triangles {
        let centroid = Node::Centroid(t);
        for k in 0..3 {
            let (a, b) = (t[k], t[(k + 1) % 3]);
            if groups[a] != groups[b] {
                let middle = Node::middle(a, b);
                // Counter-clockwise around `a` the border leaves the edge, around `b` it returns to it.
                steps.push((groups[a], middle, centroid));
                steps.push((groups[b], centroid, middle));
            }
        }
    }
    for [a, b] in boundary_edges(mesh) {
        let middle = Node::middle(a, b);
        steps.push((groups[a], Node::Vertex(a), middle));
        steps.push((groups[b], middle, Node::Vertex(b)));
    }
    steps
}

#[cfg(test)]
mod tests {
    use crate::mesh::shapes;

    use super::*;

    fn area(outline: &Outline) -> f64 {
        let c = &outline.corners;
        (0..c.len()).map(|i| 0.5 * c[i].perp_dot(c[(i + 1) % c.len()])).sum()
    }

    /// Areas of cells are known without their outlines: a third of each face for each corner.
    #[test]
    fn outlines_enclose_the_area_of_their_cells() {
        let mesh = shapes::lattice(9, 8, 1.0);
        let uv = mesh.positions.map(|p| p.truncate());
        for parts in [1, 2, 5, 100] {
            let groups: IdVec<_, _> =
                mesh.positions.ids().map(|v| (7 * v.raw() + v.raw() / 9) % parts).collect();
            let mut expected = vec![0.0; parts as usize];
            for (v, a) in mesh.vertex_areas().enumerate() {
                expected[groups[v] as usize] += a;
            }
            let mut found = vec![0.0; parts as usize];
            for outline in outlines(&mesh, &uv, &groups) {
                found[outline.group as usize] += area(&outline);
            }
            for (f, e) in found.iter().zip(&expected) {
                assert!((f - e).abs() < 1e-12, "{parts} groups: {found:?}, not {expected:?}");
            }
        }
    }

    #[test]
    fn one_group_has_the_boundary_as_its_outline() {
        let mesh = shapes::tube(8, 3, 1.0, 1.0);
        let uv = mesh.positions.map(|p| p.truncate() * (1.0 + p.z));
        let groups = IdVec::filled(0, mesh.positions.len());
        let outlines = outlines(&mesh, &uv, &groups);
        assert_eq!(outlines.len(), 2, "a tube has two boundary loops");
        assert!(outlines.iter().all(|o| o.corners.len() == 16), "vertices and middles of edges");
    }
}
