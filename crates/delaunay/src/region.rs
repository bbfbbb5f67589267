//! The constrained Delaunay triangulation of a region between closed polygons, without new points.

use glam::DVec2;
use spade::{ConstrainedDelaunayTriangulation, Triangulation};

use crate::DelaunayError;
use crate::triangulate::{Site, sites, smallest_first};

/// Counter-clockwise triangles of indices of `points` that cover the region on the left of `edges`:
/// directed edges of one or more closed polygons.
///
/// Constrained Delaunay: every edge is a side of a triangle, and no circumcircle contains a point that is
/// visible from its triangle. Each triangle starts with its smallest index, and triangles are sorted.
///
/// # Errors
/// If a coordinate is out of range, two points coincide, or edges cross or touch.
pub fn triangulate_region(points: &[DVec2], edges: &[[usize; 2]]) -> Result<Vec<[usize; 3]>, DelaunayError> {
    let refused = |e: spade::InsertionError| DelaunayError::Refused { reason: e.to_string() };
    let mut crossed = None;
    let triangulation =
        ConstrainedDelaunayTriangulation::<Site>::try_bulk_load_cdt(sites(points)?, edges.to_vec(), |edge| {
            crossed = Some(edge)
        })
        .map_err(refused)?;
    if let Some(edge) = crossed {
        return Err(DelaunayError::Crossed { edge });
    }
    let mut inside = vec![false; triangulation.num_all_faces()];
    let mut open = Vec::new();
    for &[from, to] in edges {
        let handle = |k| spade::handles::FixedVertexHandle::from_index(k);
        let edge = triangulation.get_edge_from_neighbors(handle(from), handle(to));
        // A point on an edge splits it.
        let edge =
            edge.filter(|e| e.is_constraint_edge()).ok_or(DelaunayError::Crossed { edge: [from, to] })?;
        open.extend(edge.face().as_inner());
    }
    let mut triangles = Vec::new();
    while let Some(face) = open.pop() {
        if std::mem::replace(&mut inside[face.index()], true) {
            continue;
        }
        triangles.push(smallest_first(face.vertices().map(|v| v.data().point)));
        for edge in face.adjacent_edges() {
            if !edge.is_constraint_edge() {
                open.extend(edge.rev().face().as_inner());
            }
        }
    }
    triangles.sort_unstable();
    Ok(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SQUARES: [[f64; 2]; 8] =
        [[0., 0.], [3., 0.], [3., 3.], [0., 3.], [1., 1.], [2., 1.], [2., 2.], [1., 2.]];

    fn points(at: &[[f64; 2]]) -> Vec<DVec2> {
        at.iter().map(|&p| DVec2::from_array(p)).collect()
    }

    fn ring(corners: &[usize]) -> Vec<[usize; 2]> {
        (0..corners.len()).map(|k| [corners[k], corners[(k + 1) % corners.len()]]).collect()
    }

    #[test]
    fn a_square_with_a_square_hole_is_covered_without_the_hole() {
        let points = points(&SQUARES);
        let edges = [ring(&[0, 1, 2, 3]), ring(&[7, 6, 5, 4])].concat();
        let triangles = triangulate_region(&points, &edges).unwrap();
        let twice = |t: &[usize; 3]| {
            let [a, b, c] = t.map(|k| points[k]);
            (b - a).perp_dot(c - a)
        };
        assert_eq!(triangles.iter().map(twice).sum::<f64>(), 16.0);
        assert!(triangles.iter().all(|t| twice(t) > 0.0) && triangles.len() == 8, "{triangles:?}");
    }

    /// An L is not convex: the corner between its ends stays outside.
    #[test]
    fn a_polygon_of_k_corners_has_k_minus_two_triangles() {
        let l = points(&[[0., 0.], [3., 0.], [3., 1.], [1., 1.], [1., 3.], [0., 3.]]);
        assert_eq!(triangulate_region(&l, &ring(&[0, 1, 2, 3, 4, 5])).unwrap().len(), 4);
    }

    #[test]
    fn edges_that_cross_or_touch_are_refused() {
        let points = points(&SQUARES);
        let crossing = triangulate_region(&points[..4], &ring(&[0, 2, 1, 3]));
        assert!(matches!(crossing, Err(DelaunayError::Crossed { .. })), "{crossing:?}");
        let touching: Vec<DVec2> = [DVec2::new(1.5, 0.0)].into_iter().chain(points[..4].to_vec()).collect();
        let found = triangulate_region(&touching, &ring(&[1, 2, 3, 4]));
        assert_eq!(found, Err(DelaunayError::Crossed { edge: [1, 2] }));
    }
}
