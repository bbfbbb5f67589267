//! The triangles around one point.

use glam::DVec2;
use spade::handles::{FixedVertexHandle, VertexHandle};
use spade::{DelaunayTriangulation, InsertionError, Point2, Triangulation};

use crate::DelaunayError;
use crate::triangulate::coordinates;

/// Points that are inserted before any test whether a further one matters: the ring of a lattice.
const RING: usize = 6;

/// The triangles around the origin in the Delaunay triangulation of it and `points`: counter-clockwise, as
/// pairs of indices of `points`.
///
/// Points must be sorted by distance: those beyond all circumcircles of the origin's triangles are not
/// inserted. Of coincident points the first counts. Of the triangulations of points on a common circle one is
/// chosen, by their order.
///
/// # Errors
/// If a coordinate is out of range.
pub fn star(points: &[DVec2]) -> Result<Vec<[usize; 2]>, DelaunayError> {
    let mut triangulation = DelaunayTriangulation::<Point2<f64>>::new();
    let refused = |e: InsertionError| DelaunayError::Refused { reason: e.to_string() };
    let origin = triangulation.insert(Point2::new(0.0, 0.0)).map_err(refused)?;
    // The index in `points` of each vertex after the origin.
    let mut places = Vec::with_capacity(points.len());
    for (point, &p) in points.iter().enumerate() {
        // Points may be sorted up to rounding.
        if point >= RING && 0.999 * p.length() > reach(triangulation.vertex(origin)) {
            break;
        }
        let [x, y] = coordinates(point, p)?;
        let vertex = triangulation.insert_with_hint(Point2::new(x, y), origin).map_err(refused)?;
        if vertex.index() > places.len() {
            places.push(point);
        }
    }
    let place = |vertex: FixedVertexHandle| places[vertex.index() - 1];
    let around = triangulation.vertex(origin).out_edges();
    let triangle = around.filter(|edge| !edge.is_outer_edge());
    Ok(triangle.map(|edge| [place(edge.to().fix()), place(edge.next().to().fix())]).collect())
}

/// How far from the origin the circumcircles of its triangles reach; infinite if it is on the boundary.
fn reach(origin: VertexHandle<'_, Point2<f64>>) -> f64 {
    let faces = origin.out_edges().map(|edge| edge.face().as_inner());
    let diameters = faces.map(|face| face.map_or(f64::INFINITY, |face| 2.0 * face.circumcircle().1.sqrt()));
    // A NaN stays.
    diameters.fold(0.0, |most, d| if d <= most { most } else { d })
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::triangulate::{Site, sites};

    fn triangulate(points: &[DVec2]) -> Result<Vec<[usize; 3]>, DelaunayError> {
        let whole = DelaunayTriangulation::<Site>::bulk_load(sites(points)?)
            .map_err(|e| DelaunayError::Refused { reason: e.to_string() })?;
        Ok(whole.inner_faces().map(|face| face.vertices().map(|v| v.data().point)).collect())
    }

    proptest! {
        #[test]
        fn a_star_is_a_part_of_the_triangulation(points in prop::collection::vec((-1.0..1.0, -1.0..1.0), 0..60)) {
            let mut points: Vec<DVec2> = points.into_iter().map(DVec2::from).collect();
            points.sort_by(|a, b| a.length().total_cmp(&b.length()));
            let whole = triangulate(&[&[DVec2::ZERO], points.as_slice()].concat()).unwrap();
            let around = |t: &[usize; 3]| {
                let k = t.iter().position(|&v| v == 0)?;
                Some([t[(k + 1) % 3] - 1, t[(k + 2) % 3] - 1])
            };
            let expected: BTreeSet<[usize; 2]> = whole.iter().filter_map(around).collect();
            prop_assert_eq!(star(&points).unwrap().into_iter().collect::<BTreeSet<_>>(), expected);
        }
    }

    #[test]
    fn of_coincident_points_the_first_counts() {
        let points = [DVec2::ZERO, DVec2::X, DVec2::X, DVec2::Y];
        assert_eq!(star(&points).unwrap(), [[1, 3]]);
        assert_eq!(star(&[]).unwrap(), [[0_usize; 2]; 0]);
        assert!(matches!(star(&[DVec2::X, DVec2::NAN]), Err(DelaunayError::OutOfRange { point: 1, .. })));
    }
}
