//! Laws of the room `delaunay`.
#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use std::collections::BTreeSet;

use dermatome::delaunay::{DelaunayError, Star, triangulate};
use glam::{DMat3, DVec2};
use proptest::prelude::*;

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
    let start =
        (0..points.len()).min_by(|&a, &b| points[a].to_array().partial_cmp(&points[b].to_array()).unwrap());
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
fn a_corner_of_a_square_sees_both_diagonals() {
    // Around the corner at the origin: its two neighbours, then the corner across.
    let points = [[1., 0.], [0., 1.], [1., 1.]].map(DVec2::from_array);
    let mut star: Vec<_> = Star::default().around(points, 10.0).collect();
    star.sort_unstable();
    assert_eq!(star, [[0, 2], [2, 1]], "the corner across lies between the others");
    assert_eq!(Star::default().around(points, 0.7).count(), 0, "the circle is wider than the reach");
    assert_eq!(Star::default().around([], 1.0).count(), 0);
}

#[test]
fn points_on_a_line_have_no_triangles() {
    let line: Vec<DVec2> = (0..10).map(|i| DVec2::splat(f64::from(i))).collect();
    for points in [&line[..], &line[..2], &line[..1], &[]] {
        assert_eq!(triangulate(points).unwrap(), [[0_usize; 3]; 0]);
    }
}

#[test]
fn what_has_no_triangulation_is_named() {
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
    /// The star of a point is what the whole triangulation has around it.
    #[test]
    fn a_star_is_a_part_of_the_triangulation(points in prop::collection::vec((0.0..1.0, 0.0..1.0), 3..60)) {
        const REACH: f64 = 3.0;
        let points: Vec<DVec2> = points.into_iter().map(DVec2::from).collect();
        let whole = triangulate(&points).unwrap();
        let radius = |t: [usize; 3]| {
            let [a, b, c] = t.map(|k| points[k]);
            a.distance(b) * b.distance(c) * c.distance(a) / (2.0 * (b - a).perp_dot(c - a).abs())
        };
        let mut star = Star::default();
        for v in 0..points.len() {
            let mut order: Vec<usize> = (0..points.len()).filter(|&w| w != v).collect();
            order.sort_by(|&a, &b| points[v].distance(points[a]).total_cmp(&points[v].distance(points[b])));
            let around = order.iter().map(|&w| points[w] - points[v]);
            // Circles as wide as the reach may be told either way.
            let near = |t: &[usize; 3]| radius(*t) < 0.99 * REACH;
            let found: BTreeSet<[usize; 3]> =
                star.around(around, REACH).map(|[a, b]| [v, order[a], order[b]]).filter(near).collect();
            let turned = |t: &[usize; 3]| [[t[0], t[1], t[2]], [t[1], t[2], t[0]], [t[2], t[0], t[1]]];
            let expected: BTreeSet<[usize; 3]> =
                whole.iter().filter(|t| near(t)).flat_map(turned).filter(|t| t[0] == v).collect();
            prop_assert_eq!(found, expected);
        }
    }

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
