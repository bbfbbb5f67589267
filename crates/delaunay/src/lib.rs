//! Planar triangulations of point sets and regions. The only crate of dermatome that uses spade
//! and robust.
//!
//! `flatten` fills the holes of a map with it, and `skin::triangulate` makes the triangles of taxels that
//! have none from stars in their tangent planes.
//!
//! A crate of its own, so that an edit elsewhere does not compile spade's generic code again.
#![warn(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

use glam::DVec2;
use robust::{Coord, orient2d};

mod region;
mod star;
mod triangulate;

pub use region::triangulate_region;
pub use star::star;
pub use triangulate::smallest_first;

/// The side of the line from `a` to `b` on which the point `c` lies, exactly `(shewchuk1997)`: 1 on the left
/// (counter-clockwise), -1 on the right, 0 on the line; NaN if a point is not finite.
///
/// An area may underflow in a product of two areas; its sign does not.
pub fn orientation([a, b, c]: [DVec2; 3]) -> f64 {
    let [a, b, c] = [a, b, c].map(|p| Coord { x: p.x, y: p.y });
    let area = orient2d(a, b, c);
    if area == 0.0 { 0.0 } else { area.signum() }
}

/// Whether two segments of the plane have a common point, exactly; false if an end is not finite.
pub fn segments_meet(s: [DVec2; 2], t: [DVec2; 2]) -> bool {
    let straddles = |[from, to]: [DVec2; 2], t: [DVec2; 2]| {
        let [a, b] = t.map(|p| orientation([from, to, p]));
        a * b <= 0.0
    };
    // Segments of one line straddle each other wherever they are.
    let [(s_low, s_high), (t_low, t_high)] = [s, t].map(|[a, b]| (a.min(b), a.max(b)));
    (s_low.cmple(t_high) & t_low.cmple(s_high)).all() && straddles(s, t) && straddles(t, s)
}

/// Why points have no Delaunay triangulation.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
#[expect(missing_docs, reason = "the messages say what is wrong")]
pub enum DelaunayError {
    #[error("point {point} lies at {position:?}; coordinates must be finite and below 1e60 m")]
    OutOfRange { point: usize, position: [f64; 2] },
    #[error("points {first} and {second} both lie at {position:?}; points must differ")]
    Coincident { first: usize, second: usize, position: [f64; 2] },
    #[error("the edge between points {} and {} meets another one; polygons must not touch", edge[0], edge[1])]
    Crossed { edge: [usize; 2] },
    #[error("the points cannot be triangulated: {reason}")]
    Refused { reason: String },
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points near a line, one unit of the last place apart: the rounded determinant is wrong for
    /// many of them.
    #[test]
    fn the_sign_is_that_of_integers() {
        let unit = 2_f64.powi(-52);
        let at = |i: i64, j: i64| DVec2::new(0.5 + i as f64 * unit, 0.5 + j as f64 * unit);
        let (from, to) = (DVec2::splat(12.0), DVec2::splat(24.0));
        let mut wrong = 0;
        for i in 0..32 {
            for j in 0..32 {
                let p = at(i, j);
                let expected = (j - i).signum() as f64;
                assert_eq!(orientation([from, to, p]), expected, "{i} {j}");
                assert_eq!(orientation([to, from, p]), -expected, "{i} {j}");
                wrong += usize::from((to - from).perp_dot(p - from).signum() != expected);
            }
        }
        assert!(wrong > 0, "rounding matters here");
    }

    #[test]
    fn segments_of_one_line_meet_where_they_overlap() {
        let on_line = |a: f64, b: f64| [a, b].map(|x| DVec2::new(x, 2.0 * x));
        assert!(segments_meet(on_line(0.0, 2.0), on_line(3.0, 1.0)));
        assert!(segments_meet(on_line(0.0, 1.0), on_line(1.0, 2.0)), "a common end");
        assert!(!segments_meet(on_line(0.0, 1.0), on_line(2.0, 3.0)));
        assert!(segments_meet([DVec2::ZERO, DVec2::ONE], [DVec2::X, DVec2::Y]));
        assert!(!segments_meet([DVec2::ZERO, DVec2::ONE], [DVec2::X, DVec2::new(2.0, 0.0)]));
    }

    #[test]
    fn points_that_are_not_finite_have_no_side() {
        assert!(orientation([DVec2::NAN, DVec2::X, DVec2::Y]).is_nan());
    }
}
