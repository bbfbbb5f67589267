use glam::DVec2;

use crate::{
    id::VertexId,
    skin::triangulate::{delaunay_star::DelaunayStar, point_cloud::Surroundings},
};

/// Neighbours whose normal is turned by a right angle or more lie on another side of the part.
const SAME_SIDE: f64 = 0.0;

/// A neighbour that is seen more steeply than 64 degrees above the tangent plane lies across the part, not along it.
const STEEPEST: f64 = 0.9;

/// Circles of triangles may be wider than the gap by this factor. At 1, an alpha shape, a gap between rows of taxels stays open
/// that is a little narrower than the limit; much above, slivers fill the notches of every boundary.
const WIDEST: f64 = 1.2;

/// The triangles around `v` of the Delaunay triangulation of its neighbours in its tangent plane.
///
/// Neighbours are unrolled: they keep their distance, and the direction in which they are seen.
pub(super) fn tangent_star(
    star: &mut DelaunayStar,
    v: VertexId,
    around: &Surroundings<'_>,
) -> Vec<[VertexId; 3]> {
    let Surroundings { positions, normals, neighbours, gap } = *around;
    let (n, spacing) = (normals[v], neighbours.spacing[v]);
    let (e, f) = n.any_orthonormal_pair();
    let mut beside = Vec::new();
    let mut seen = Vec::new();
    for &w in neighbours.of(v) {
        let d = (positions[w] - positions[v]) / spacing;
        let length = d.length();
        if normals[w].dot(n) > SAME_SIDE && d.dot(n).abs() <= STEEPEST * length {
            beside.push(w);
            seen.push(length * DVec2::new(d.dot(e), d.dot(f)).normalize_or_zero());
        }
    }
    star.around(seen, 0.5 * WIDEST * gap).map(|[a, b]| [v, beside[a], beside[b]]).collect()
}
