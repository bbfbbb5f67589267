//! The Delaunay triangulation of points of the plane.

use std::collections::HashMap;

use glam::DVec2;
use spade::{DelaunayTriangulation, HasPosition, MIN_ALLOWED_VALUE, Point2, Triangulation};

use crate::DelaunayError;

/// Coordinates above this are refused, well before the exact predicates overflow.
const MAX_COORDINATE: f64 = 1e60;

/// A point that knows its index: `spade` orders its vertices as it likes.
pub(super) struct Site {
    pub(super) point: usize,
    position: Point2<f64>,
}

impl HasPosition for Site {
    type Scalar = f64;
    fn position(&self) -> Point2<f64> {
        self.position
    }
}

/// The Delaunay triangulation of `points`: counter-clockwise triangles of indices that cover the
/// convex hull, none with another point inside its circumcircle.
///
/// Each triangle starts with its smallest index, and triangles are sorted. Fewer than three points,
/// or points on one line, have no triangles. Predicates are exact; coordinates below 2e-43 in size
/// count as zero. Of the triangulations of points on a common circle one is chosen, always the same
/// for the same points in the same order.
///
/// # Errors
/// If a coordinate is out of range or two points coincide: merging them is left to the caller, who
/// knows what they are.
pub fn triangulate(points: &[DVec2]) -> Result<Vec<[usize; 3]>, DelaunayError> {
    let sites = sites(points)?;
    let triangulation = DelaunayTriangulation::<Site>::bulk_load(sites)
        .map_err(|e| DelaunayError::Refused { reason: e.to_string() })?;
    let mut triangles: Vec<[usize; 3]> = triangulation
        .inner_faces()
        .map(|face| smallest_first(face.vertices().map(|v| v.data().point)))
        .collect();
    triangles.sort_unstable();
    Ok(triangles)
}

/// The corners of a triangle in their order, from the smallest on.
pub fn smallest_first<T: Ord>([a, b, c]: [T; 3]) -> [T; 3] {
    if a < b && a < c {
        [a, b, c]
    } else if b < c {
        [b, c, a]
    } else {
        [c, a, b]
    }
}

/// The coordinates of a point as `spade` takes them.
pub(super) fn coordinates(point: usize, p: DVec2) -> Result<[f64; 2], DelaunayError> {
    let position = p.to_array();
    if !position.iter().all(|x| x.abs() < MAX_COORDINATE) {
        return Err(DelaunayError::OutOfRange { point, position });
    }
    Ok(position.map(|x| if x.abs() < MIN_ALLOWED_VALUE { 0.0 } else { x }))
}

/// The points as `spade` takes them, all different.
pub(super) fn sites(points: &[DVec2]) -> Result<Vec<Site>, DelaunayError> {
    let mut first_at = HashMap::with_capacity(points.len());
    let mut sites = Vec::with_capacity(points.len());
    for (point, p) in points.iter().enumerate() {
        let [x, y] = coordinates(point, *p)?;
        let first = *first_at.entry([x, y].map(f64::to_bits)).or_insert(point);
        if first != point {
            return Err(DelaunayError::Coincident { first, second: point, position: p.to_array() });
        }
        sites.push(Site { point, position: Point2::new(x, y) });
    }
    Ok(sites)
}

#[cfg(test)]
mod tests {
    use glam::DMat3;
    use proptest::prelude::*;

    use super::*;

    /// Twice the signed area of a triangle.
    fn cross(points: &[DVec2], [a, b, c]: [usize; 3]) -> f64 {
        (points[b] - points[a]).perp_dot(points[c] - points[a])
    }

    /// Positive if `p` lies inside the circle through the corners.
    fn in_circle(points: &[DVec2], t: [usize; 3], p: DVec2) -> f64 {
        let row = |i: usize| (points[t[i]] - p).extend((points[t[i]] - p).length_squared());
        DMat3::from_cols(row(0), row(1), row(2)).determinant()
    }

    /// Area of the convex hull, by its corners in the order of a gift wrapping.
    fn hull_area(points: &[DVec2]) -> f64 {
        let start = (0..points.len())
            .min_by(|&a, &b| points[a].to_array().partial_cmp(&points[b].to_array()).unwrap());
        let (mut at, mut area) = (start.unwrap(), 0.0);
        loop {
            let mut next = (at + 1) % points.len();
            for q in 0..points.len() {
                let side = cross(points, [at, next, q]);
                let further = points[at].distance(points[q]) > points[at].distance(points[next]);
                if side < 0.0 || (side == 0.0 && further) {
                    next = q;
                }
            }
            area += 0.5 * points[at].perp_dot(points[next]);
            at = next;
            if Some(at) == start {
                return area;
            }
        }
    }

    #[test]
    fn a_square_with_its_middle_has_four_triangles() {
        let points = [[0., 0.], [1., 0.], [1., 1.], [0., 1.], [0.5, 0.5]].map(DVec2::from_array);
        assert_eq!(triangulate(&points).unwrap(), [[0, 1, 4], [0, 4, 3], [1, 2, 4], [2, 3, 4]]);
    }

    #[test]
    fn points_on_a_line_have_no_triangles() {
        let line: Vec<DVec2> = (0..10).map(|i| DVec2::splat(f64::from(i))).collect();
        for points in [&line[..], &line[..2], &line[..1], &[]] {
            assert_eq!(triangulate(points).unwrap(), [[0_usize; 3]; 0]);
        }
    }

    #[test]
    fn invalid_points_are_refused() {
        let p = DVec2::new;
        let twice = [p(0., 0.), p(1., 0.), p(0., 1.), p(1., 0.)];
        assert!(matches!(triangulate(&twice), Err(DelaunayError::Coincident { first: 1, second: 3, .. })));
        // Zero and minus zero are one place, and so is what is too small for the predicates.
        let zeros = [p(0., 0.), p(1., 0.), p(-0., 1e-50)];
        assert!(matches!(triangulate(&zeros), Err(DelaunayError::Coincident { first: 0, second: 2, .. })));
        for x in [f64::NAN, f64::INFINITY, 1e61] {
            let far = [p(0., 0.), p(1., 0.), p(0., x)];
            assert!(matches!(triangulate(&far), Err(DelaunayError::OutOfRange { point: 2, .. })));
        }
    }

    proptest! {
        /// Integer coordinates make every quantity exact, and points on lines and circles common.
        #[test]
        fn circumcircles_are_empty_and_triangles_cover_the_hull(
            places in prop::collection::btree_set((-8_i32..8, -8_i32..8), 3..60),
            keys in prop::collection::vec(any::<u32>(), 60),
        ) {
            let mut order: Vec<_> = places.into_iter().zip(keys).collect();
            order.sort_by_key(|&(_, key)| key);
            let points: Vec<DVec2> =
                order.iter().map(|&((x, y), _)| DVec2::new(f64::from(x), f64::from(y))).collect();
            let triangles = triangulate(&points).unwrap();
            let mut area = 0.0;
            for &t in &triangles {
                prop_assert!(cross(&points, t) > 0.0, "{t:?} runs counter-clockwise");
                area += 0.5 * cross(&points, t);
                for &p in &points {
                    prop_assert!(in_circle(&points, t, p) <= 0.0, "{p} lies in the circle of {t:?}");
                }
            }
            prop_assert_eq!(area, hull_area(&points));
            prop_assert_eq!(&triangles, &triangulate(&points).unwrap(), "the same again");
        }
    }
}
