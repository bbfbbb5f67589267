use std::collections::HashMap;

use glam::DVec2;
use spade::{DelaunayTriangulation, HasPosition, MIN_ALLOWED_VALUE, Point2, Triangulation};

use crate::{delaunay::DelaunayError, mesh::smallest_first};

/// Coordinates above this are refused, well before the exact predicates overflow.
const MAX_COORDINATE: f64 = 1e60;

/// A point that knows its index: `spade` orders its vertices as it likes.
struct Site {
    point: usize,
    position: Point2<f64>,
}

impl HasPosition for Site {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.position
    }
}

/// The Delaunay triangulation of `points`: counter-clockwise triangles of indices that cover the convex hull, none
/// with another point inside its circumcircle.
///
/// Each triangle starts with its smallest index, and triangles are sorted. Fewer than three points, or points on one
/// line, have no triangles. Predicates are exact; coordinates below 2e-43 in size count as zero. Of the triangulations
/// of points on a common circle one is chosen, always the same for the same points in the same order.
///
/// # Errors
/// If a coordinate is out of range or two points coincide: merging them is left to the caller, who knows what they
/// are.
pub fn triangulate(points: &[DVec2]) -> Result<Vec<[usize; 3]>, DelaunayError> {
    let mut first_at = HashMap::with_capacity(points.len());
    let mut sites = Vec::with_capacity(points.len());
    for (point, p) in points.iter().enumerate() {
        let position = p.to_array();
        if !position.iter().all(|x| x.abs() < MAX_COORDINATE) {
            return Err(DelaunayError::OutOfRange { point, position });
        }
        let [x, y] = position.map(|x| if x.abs() < MIN_ALLOWED_VALUE { 0.0 } else { x });
        let first = *first_at.entry([x, y].map(f64::to_bits)).or_insert(point);
        if first != point {
            return Err(DelaunayError::Coincident { first, second: point, position });
        }
        sites.push(Site { point, position: Point2::new(x, y) });
    }
    let triangulation = DelaunayTriangulation::<Site>::bulk_load(sites)
        .map_err(|e| DelaunayError::Refused { reason: e.to_string() })?;
    let mut triangles: Vec<[usize; 3]> = triangulation
        .inner_faces()
        .map(|face| smallest_first(face.vertices().map(|v| v.data().point)))
        .collect();
    triangles.sort_unstable();
    Ok(triangles)
}
