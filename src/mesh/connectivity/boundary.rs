//! Edges and boundaries of any set of triangles, manifold or not, whose corners exist.

use crate::{
    id::VertexId,
    mesh::{TriMesh, connectivity::edges::each_edge},
    numeric::chains,
};

/// Every undirected edge once, smaller vertex first, sorted.
pub(crate) fn edges(mesh: &TriMesh) -> Vec<[VertexId; 2]> {
    let mut edges = Vec::new();
    each_edge(&mesh.triangles, mesh.positions.len(), |along| {
        let h = along[0];
        let [a, b] = [h.start(mesh), h.end(mesh)];
        edges.push([a.min(b), a.max(b)]);
    });
    edges
}

/// The edges of exactly one face, in the direction in which that face runs, sorted.
pub(crate) fn boundary_edges(mesh: &TriMesh) -> Vec<[VertexId; 2]> {
    let mut edges = Vec::new();
    each_edge(&mesh.triangles, mesh.positions.len(), |along| {
        if let [h] = *along {
            edges.push([h.start(mesh), h.end(mesh)]);
        }
    });
    edges.sort_unstable();
    edges
}

/// The boundary as loops of vertices, faces on the left, each from its smallest vertex; of
/// triangles that are not an oriented manifold as far as it closes.
pub(crate) fn boundary_loops(mesh: &TriMesh) -> Vec<Vec<VertexId>> {
    loops_of(&boundary_edges(mesh))
}

/// The loops of directed edges, which must be sorted.
pub(crate) fn loops_of(edges: &[[VertexId; 2]]) -> Vec<Vec<VertexId>> {
    let next = |k: usize| {
        let end = edges[k][1];
        let place = edges.partition_point(|edge| edge[0] < end);
        edges.get(place).is_some_and(|edge| edge[0] == end).then_some(place)
    };
    let vertices = |walk: Vec<usize>| walk.into_iter().map(|k| edges[k][0]).collect();
    chains(edges.len(), next).into_iter().map(vertices).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::{Adjacency, shapes};

    #[test]
    fn loops_are_those_of_the_adjacency() {
        for mesh in [shapes::fan(5), shapes::lattice(7, 6, 1.0), shapes::tube(5, 4, 1.0, 2.0)] {
            let adjacency = Adjacency::new(&mesh).unwrap();
            assert_eq!(boundary_loops(&mesh), adjacency.boundary_loops());
            assert_eq!(edges(&mesh).len(), adjacency.rings.edges());
        }
    }

    #[test]
    fn an_edge_of_three_faces_is_not_on_the_boundary() {
        let book = TriMesh::from_arrays(vec![glam::DVec3::ZERO; 5], &[[0, 1, 2], [0, 1, 3], [1, 0, 4]]);
        let found = boundary_edges(&book);
        assert!(!found.contains(&[0, 1].map(VertexId::new)), "{found:?}");
        assert_eq!(found.len(), 6);
    }
}
