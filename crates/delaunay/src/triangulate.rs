//! The points of a triangulation in the types of `spade`.

use std::collections::HashMap;

use glam::DVec2;
use spade::{HasPosition, MIN_ALLOWED_VALUE, Point2};

use crate::DelaunayError;

/// Coordinates above this are refused, well before the exact predicates overflow.
const MAX_COORDINATE: f64 = 1e60;

/// A point with its index: `spade` reorders its vertices.
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

/// The coordinates of a point for `spade`.
pub(super) fn coordinates(point: usize, p: DVec2) -> Result<[f64; 2], DelaunayError> {
    let position = p.to_array();
    if !position.iter().all(|x| x.abs() < MAX_COORDINATE) {
        return Err(DelaunayError::OutOfRange { point, position });
    }
    Ok(position.map(|x| if x.abs() < MIN_ALLOWED_VALUE { 0.0 } else { x }))
}

/// The points for `spade`, all different.
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
    use super::*;

    #[test]
    fn invalid_points_are_refused() {
        let (p, refusal) = (DVec2::new, |points: &[DVec2]| sites(points).err());
        let twice = refusal(&[p(0., 0.), p(1., 0.), p(0., 1.), p(1., 0.)]);
        assert!(matches!(twice, Some(DelaunayError::Coincident { first: 1, second: 3, .. })));
        // Zero, minus zero and numbers too small for the predicates are one position.
        let zeros = refusal(&[p(0., 0.), p(1., 0.), p(-0., 1e-50)]);
        assert!(matches!(zeros, Some(DelaunayError::Coincident { first: 0, second: 2, .. })));
        for x in [f64::NAN, f64::INFINITY, 1e61] {
            let far = refusal(&[p(0., 0.), p(1., 0.), p(0., x)]);
            assert!(matches!(far, Some(DelaunayError::OutOfRange { point: 2, .. })));
        }
    }
}
