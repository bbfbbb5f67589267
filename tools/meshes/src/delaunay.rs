//! Delaunay triangulations, by spade.

use glam::DVec2;
use spade::{DelaunayTriangulation, HasPosition, Point2, Triangulation};

/// A point that knows its index: spade orders its vertices as it likes.
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

/// The Delaunay triangulation of points that differ: counter-clockwise triangles of indices, each
/// from its smallest on, sorted.
///
/// # Panics
/// If a coordinate is not finite.
pub(crate) fn triangulate(points: &[DVec2]) -> Vec<[usize; 3]> {
    let site = |(point, p): (usize, &DVec2)| Site { point, position: Point2::new(p.x, p.y) };
    let sites = points.iter().enumerate().map(site).collect();
    let triangulation = DelaunayTriangulation::<Site>::bulk_load(sites).expect("finite points");
    let mut triangles: Vec<[usize; 3]> = triangulation
        .inner_faces()
        .map(|face| {
            let mut corners = face.vertices().map(|v| v.data().point);
            let smallest = (0..3).min_by_key(|&k| corners[k]).unwrap_or_default();
            corners.rotate_left(smallest);
            corners
        })
        .collect();
    triangles.sort_unstable();
    triangles
}
