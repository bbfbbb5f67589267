//! The boundary edges of a map that cross or touch: every pair once, found by a tree over their boxes.
//!
//! The tests are exact signs of areas, compared one by one: neither rounding nor underflow hides a
//! crossing.

use std::{collections::BTreeSet, ops::ControlFlow};

use crate::bvh::{Aabb, BoxTree};
use crate::delaunay::segments_meet;
use crate::flatten::energy::elements::Uv;
use crate::id::VertexId;

/// Crossings are counted up to this number. Coincident edges have a crossing for each pair:
/// the 18 000 edges of 6000 coincident triangles have 160 million, which take a minute.
pub(crate) const MAX_CROSSINGS: usize = 1_000_000;

/// Number of pairs of boundary edges without a common vertex that cross or touch on the map, at
/// most [`MAX_CROSSINGS`].
pub(crate) fn boundary_crossings(edges: &[[VertexId; 2]], uv: &Uv) -> usize {
    crossings_up_to(MAX_CROSSINGS, edges, uv)
}

/// Whether any two boundary edges without a common vertex cross or touch on the map.
pub(crate) fn boundary_crosses_itself(edges: &[[VertexId; 2]], uv: &Uv) -> bool {
    crossings_up_to(1, edges, uv) > 0
}

/// The vertices of the boundary edges that cross or touch another one on the map, ids ascending; of the first
/// [`MAX_CROSSINGS`] pairs.
#[doc(hidden)]
pub fn crossing_vertices(edges: &[[VertexId; 2]], uv: &Uv) -> Vec<VertexId> {
    let mut found = BTreeSet::new();
    each_crossing(MAX_CROSSINGS, edges, uv, &mut |pair| found.extend(pair.into_iter().flatten()));
    found.into_iter().collect()
}

fn crossings_up_to(most: usize, edges: &[[VertexId; 2]], uv: &Uv) -> usize {
    each_crossing(most, edges, uv, &mut |_| ())
}

/// Calls `found` with each of the first `most` pairs of edges that cross or touch; returns their number.
fn each_crossing(
    most: usize,
    edges: &[[VertexId; 2]],
    uv: &Uv,
    found: &mut dyn FnMut([[VertexId; 2]; 2]),
) -> usize {
    // An edge that is not finite touches nothing.
    let edges: Vec<_> = edges.iter().filter(|ends| ends.iter().all(|&v| uv[v].is_finite())).collect();
    let boxes: Vec<Aabb> = edges.iter().map(|ends| Aabb::flat(ends.map(|v| uv[v]))).collect();
    let tree = BoxTree::new(&boxes).expect("the edges are finite");
    let mut count = 0;
    let _ = tree.each_pair(|i, j| {
        let [s, t] = [i, j].map(|k| *edges[k]);
        if !s.iter().any(|v| t.contains(v)) && segments_meet(s.map(|v| uv[v]), t.map(|v| uv[v])) {
            count += 1;
            found([s, t]);
        }
        if count < most { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
    });
    count
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::mesh::{TriMesh, boundary_edges, shapes};

    fn crossings(mesh: &TriMesh, uv: &Uv) -> usize {
        boundary_crossings(&boundary_edges(mesh), uv)
    }

    fn flat(mesh: &TriMesh) -> Uv {
        mesh.positions.map(|p| p.truncate())
    }

    #[test]
    fn a_bow_tie_crosses_once() {
        let mesh = shapes::square();
        let mut uv = flat(&mesh);
        let (b, c) = (uv[VertexId::new(1)], uv[VertexId::new(2)]);
        (uv[VertexId::new(1)], uv[VertexId::new(2)]) = (c, b);
        assert_eq!(crossings(&mesh, &uv), 1, "two opposite sides of the square");
    }

    /// 2000 coincident triangles have 18 million pairs of edges that touch.
    #[test]
    fn counting_ends_at_the_largest_number() {
        let places = [DVec2::ZERO, DVec2::X, DVec2::Y];
        let uv: Uv = (0..6000).map(|i| places[i % 3]).collect();
        let edge = |i: usize| [i, if i % 3 == 2 { i - 2 } else { i + 1 }].map(VertexId::new);
        let edges: Vec<_> = (0..6000).map(edge).collect();
        assert_eq!(boundary_crossings(&edges, &uv), MAX_CROSSINGS);
        assert!(boundary_crosses_itself(&edges, &uv));
    }

    /// The tree must find the same as a comparison of every pair.
    #[test]
    fn the_tree_finds_every_pair() {
        let mesh = shapes::lattice(40, 3, 0.01);
        // A strip rolled up one and a half times around a slightly shrinking circle.
        let uv =
            mesh.positions.map(|p| DVec2::from_angle(p.x * 23.0) * (0.3 + 0.02 * (p.x * 60.0).sin() + p.y));
        let edges = boundary_edges(&mesh);
        let cross = |s: [VertexId; 2], t: [VertexId; 2]| {
            s.iter().all(|v| !t.contains(v)) && segments_meet(s.map(|v| uv[v]), t.map(|v| uv[v]))
        };
        let all: usize =
            (1..edges.len()).map(|i| edges[..i].iter().filter(|s| cross(**s, edges[i])).count()).sum();
        assert!(all > 0, "the strip overlaps itself");
        assert_eq!(crossings(&mesh, &uv), all);
    }
}
