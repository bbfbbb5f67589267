//! The triangles of a Delaunay triangulation around one point, without the rest of it.

use glam::DVec2;

use crate::mesh::clip;

/// A point is on a circle if it is this close to it, over the square of its distance: the corners
/// of a square are on one circle in any frame.
const ON_CIRCLE: f64 = 1e-7;

/// Finds the triangles around one point.
///
/// They join the neighbours whose Voronoi cells border on that of the point. Its cell is cut out of
/// a square by the bisectors with the other points, the nearest first, until the next is too far
/// away to cut. Of four or more points on a common circle each sees all triangles that it can have
/// with them in order around it, so that the corners of a square see both of its diagonals: which
/// one is drawn is left to the caller. Keeps its memory from point to point.
#[derive(Debug, Clone, Default)]
pub(super) struct DelaunayStar {
    cell: Vec<Corner>,
    cut: Vec<Corner>,
}

/// A corner of the cell, and which point's bisector the side after it is on.
#[derive(Debug, Clone, Copy)]
struct Corner {
    at: DVec2,
    side: Option<usize>,
}

impl DelaunayStar {
    /// The triangles around the origin, as pairs of places in `points`, counter-clockwise.
    ///
    /// The points must come nearest first; triangles whose circles have a radius above `reach` are
    /// not among them.
    pub(super) fn around(
        &mut self,
        points: impl IntoIterator<Item = DVec2>,
        reach: f64,
    ) -> impl Iterator<Item = [usize; 2]> {
        self.cell.clear();
        for (x, y) in [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)] {
            self.cell.push(Corner { at: reach * DVec2::new(x, y), side: None });
        }
        for (k, point) in points.into_iter().enumerate() {
            let farthest = self.cell.iter().fold(0.0, |far: f64, c| far.max(c.at.length()));
            if point.length() > 2.0 * farthest {
                break;
            }
            self.cut_off(point, k);
        }
        let before = self.cell.iter().cycle().skip(self.cell.len() - 1);
        self.cell.iter().zip(before).filter_map(move |(corner, before)| {
            let sides = [before.side?, corner.side?];
            (sides[0] != sides[1] && corner.at.length() <= reach).then_some(sides)
        })
    }

    /// Cuts off the part of the cell that is nearer to `point` than to the origin.
    fn cut_off(&mut self, point: DVec2, k: usize) {
        let size = point.length_squared();
        let beyond = |c: &Corner| c.at.dot(point) - 0.5 * size;
        let is_cut = |c: &Corner| beyond(c) > -ON_CIRCLE * size;
        if !self.cell.iter().any(is_cut) || self.cell.iter().all(is_cut) {
            return;
        }
        let crossing = |a: &Corner, b: &Corner| {
            let (s, t) = (beyond(a), beyond(b));
            let at = a.at.lerp(b.at, (s / (s - t)).clamp(0.0, 1.0));
            Corner { at, side: if is_cut(a) { a.side } else { Some(k) } }
        };
        clip(&self.cell, |c| !is_cut(c), crossing, &mut self.cut);
        std::mem::swap(&mut self.cell, &mut self.cut);
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use proptest::prelude::*;

    use super::*;
    use crate::delaunay::triangulate;

    #[test]
    fn a_corner_of_a_square_sees_both_diagonals() {
        // Around the corner at the origin: its two neighbours, then the corner across.
        let points = [[1., 0.], [0., 1.], [1., 1.]].map(DVec2::from_array);
        let mut star: Vec<_> = DelaunayStar::default().around(points, 10.0).collect();
        star.sort_unstable();
        assert_eq!(star, [[0, 2], [2, 1]], "the corner across lies between the others");
        assert_eq!(
            DelaunayStar::default().around(points, 0.7).count(),
            0,
            "the circle is wider than the reach"
        );
        assert_eq!(DelaunayStar::default().around([], 1.0).count(), 0);
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
            let mut star = DelaunayStar::default();
            for v in 0..points.len() {
                let mut order: Vec<usize> = (0..points.len()).filter(|&w| w != v).collect();
                order.sort_by(|&a, &b| points[v].distance(points[a]).total_cmp(&points[v].distance(points[b])));
                let around = order.iter().map(|&w| points[w] - points[v]);
                // Circles as wide as the reach may be judged either way.
                let near = |t: &[usize; 3]| radius(*t) < 0.99 * REACH;
                let found: BTreeSet<[usize; 3]> =
                    star.around(around, REACH).map(|[a, b]| [v, order[a], order[b]]).filter(near).collect();
                let turned = |t: &[usize; 3]| [[t[0], t[1], t[2]], [t[1], t[2], t[0]], [t[2], t[0], t[1]]];
                let expected: BTreeSet<[usize; 3]> =
                    whole.iter().filter(|t| near(t)).flat_map(turned).filter(|t| t[0] == v).collect();
                prop_assert_eq!(found, expected);
            }
        }
    }
}
