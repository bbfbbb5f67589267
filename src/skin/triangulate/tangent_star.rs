//! The triangles around one taxel: its star in the Delaunay triangulation of its neighbours in the
//! tangent plane.
//!
//! Stars of neighbours need not agree: the tangential Delaunay complex (boissonnat2014). Star
//! splaying (shewchuk2005) makes them agree in space; here the corners vote (`candidates`).

use glam::DVec2;

use crate::{
    id::VertexId,
    skin::triangulate::{delaunay_star::DelaunayStar, point_cloud::PointCloud},
};

/// A neighbour whose normal is turned by a right angle or more lies on another side of the part.
const SAME_SIDE: f64 = 0.0;

/// A neighbour more than 64 degrees (as a sine) above the tangent plane lies across the part, not
/// along it.
const STEEPEST: f64 = 0.9;

/// Circumcircles may be wider than the gap by this factor. At 1 the result is an alpha shape, and
/// gaps between rows of taxels that are a little narrower than the limit stay open; at much more,
/// slivers fill the notches of every boundary.
const WIDEST: f64 = 1.2;

/// The triangles around `v` of the Delaunay triangulation of its neighbours in its tangent plane.
///
/// Neighbours are unrolled into the plane: they keep their distance and their direction in the
/// tangent plane.
pub(super) fn tangent_star(
    star: &mut DelaunayStar,
    v: VertexId,
    cloud: &PointCloud<'_>,
) -> Vec<[VertexId; 3]> {
    let PointCloud { positions, normals, neighbours, gap } = *cloud;
    let (n, spacing) = (normals[v], neighbours.spacing[v]);
    let (e, f) = n.any_orthonormal_pair();
    let mut candidates = Vec::new();
    let mut unrolled = Vec::new();
    for &w in neighbours.of(v) {
        let d = (positions[w] - positions[v]) / spacing;
        let length = d.length();
        if normals[w].dot(n) > SAME_SIDE && d.dot(n).abs() <= STEEPEST * length {
            candidates.push(w);
            unrolled.push(length * DVec2::new(d.dot(e), d.dot(f)).normalize_or_zero());
        }
    }
    star.around(unrolled, 0.5 * WIDEST * gap).map(|[a, b]| [v, candidates[a], candidates[b]]).collect()
}
