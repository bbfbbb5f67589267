//! Where a whole map lies on another one before it is bent: turned, scaled, moved, and half as sheared as it should be.

use glam::{DAffine2, DMat2, DVec2};

/// A move, a turn and a change of scale of the plane.
#[derive(Debug, Clone, Copy)]
pub(super) struct Similarity {
    /// The turn and the scale, as a complex number.
    turn: DVec2,
    from: DVec2,
    to: DVec2,
}

impl Similarity {
    /// The one of least squares that leads from the first to the second point of each pair; the root of the mean
    /// squared distance that is left, in m. The points must not all be one.
    pub(super) fn of(pairs: &[[DVec2; 2]]) -> (Self, f64) {
        let count = pairs.len() as f64;
        let [from, to] = [0, 1].map(|k| pairs.iter().map(|pair| pair[k]).sum::<DVec2>() / count);
        let (mut product, mut squares) = (DVec2::ZERO, 0.0);
        for pair in pairs {
            let (p, q) = (pair[0] - from, pair[1] - to);
            product += DVec2::new(p.dot(q), p.perp_dot(q));
            squares += p.length_squared();
        }
        let similarity = Self { turn: product / squares, from, to };
        let left: f64 = pairs.iter().map(|[p, q]| similarity.apply(*p).distance_squared(*q)).sum();
        (similarity, (left / count).sqrt())
    }

    pub(super) fn apply(&self, at: DVec2) -> DVec2 {
        self.to + self.turn.rotate(at - self.from)
    }

    /// The direction after it, as long as before it times the scale.
    pub(super) fn turned(&self, direction: DVec2) -> DVec2 {
        self.turn.rotate(direction)
    }
}

/// With fewer points an affine map follows the error of each.
const FEWEST_TO_SHEAR: usize = 6;

/// Where a map is placed: halfway between the similarity and the affine map of its landmarks.
///
/// *Heuristic*: medians over taxels of hands with 13 landmarks, worst of 8 moderate and of 8 hard pairs: by the
/// similarity 1.24 and 2.29 mm, halfway 1.09 and 2.18, by the affine map 1.12 and 2.49.
#[derive(Debug, Clone, Copy)]
pub(super) struct Placing {
    similarity: Similarity,
    affine: Option<DAffine2>,
}

impl Placing {
    pub(super) fn of(pairs: &[[DVec2; 2]]) -> Self {
        let (similarity, _) = Similarity::of(pairs);
        let affine = affine(pairs, &similarity).filter(|_| pairs.len() >= FEWEST_TO_SHEAR);
        // A map that is half as sheared keeps its orientation.
        let upright = affine.filter(|affine| {
            let turn = DMat2::from_cols(similarity.turn, similarity.turn.perp());
            (affine.matrix2 + turn).determinant() > 0.0
        });
        Self { similarity, affine: upright }
    }

    pub(super) fn apply(&self, at: DVec2) -> DVec2 {
        let similar = self.similarity.apply(at);
        self.affine.map_or(similar, |affine| 0.5 * (similar + affine.transform_point2(at)))
    }

    /// Lengths after it over those before, in the mean.
    pub(super) fn scale(&self) -> f64 {
        self.similarity.turn.length()
    }
}

/// The affine map of least squares; `None` where the points lie on a line.
fn affine(pairs: &[[DVec2; 2]], similarity: &Similarity) -> Option<DAffine2> {
    let (mut products, mut squares) = (DMat2::ZERO, DMat2::ZERO);
    for &[p, q] in pairs {
        let (p, q) = (p - similarity.from, q - similarity.to);
        products += DMat2::from_cols(q * p.x, q * p.y);
        squares += DMat2::from_cols(p * p.x, p * p.y);
    }
    let matrix = products * squares.inverse();
    let translation = similarity.to - matrix * similarity.from;
    matrix.is_finite().then_some(DAffine2 { matrix2: matrix, translation })
}

/// The shorter over the longer principal axis of points: 0 on a line.
pub(super) fn breadth(points: impl Iterator<Item = DVec2> + Clone) -> f64 {
    let count = points.clone().count() as f64;
    let middle = points.clone().sum::<DVec2>() / count;
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for q in points.map(|p| p - middle) {
        xx += q.x * q.x;
        xy += q.x * q.y;
        yy += q.y * q.y;
    }
    let (half, apart) = ((xx + yy) / 2.0, ((xx - yy) / 2.0).hypot(xy));
    ((half - apart).max(0.0) / (half + apart).max(f64::MIN_POSITIVE)).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::mirrored;

    #[test]
    fn a_similarity_is_found_again() {
        let points = [DVec2::ZERO, DVec2::new(2.0, 0.5), DVec2::new(-1.0, 3.0), DVec2::new(0.3, 0.2)];
        let truth = |p: DVec2| DVec2::new(0.3, -1.2).rotate(p) + DVec2::new(5.0, 7.0);
        let (found, left) = Similarity::of(&points.map(|p| [p, truth(p)]));
        assert!(left < 1e-12 && (found.turn.length() - 0.3_f64.hypot(1.2)).abs() < 1e-12);
        assert!(found.apply(DVec2::new(9.0, 9.0)).distance(truth(DVec2::new(9.0, 9.0))) < 1e-12);
        let (_, of_mirrored) = Similarity::of(&points.map(|p| [p, mirrored(truth(p))]));
        assert!(of_mirrored > 0.1);
    }

    /// Of six landmarks and more, half of a shear is in the placing.
    #[test]
    fn a_sheared_map_is_placed_halfway() {
        let points: Vec<DVec2> = (0..8).map(|k| DVec2::from_angle(f64::from(k)) * f64::from(k + 1)).collect();
        let sheared = |p: DVec2| DVec2::new(1.4 * p.x + 0.2 * p.y, 0.8 * p.y);
        let pairs: Vec<[DVec2; 2]> = points.iter().map(|&p| [p, sheared(p)]).collect();
        let (similar, _) = Similarity::of(&pairs);
        for at in [DVec2::X, DVec2::new(3.0, -7.0)] {
            let halfway = 0.5 * (similar.apply(at) + sheared(at));
            assert!(Placing::of(&pairs).apply(at).distance(halfway) < 1e-12);
            assert_eq!(Placing::of(&pairs[..5]).apply(at), Similarity::of(&pairs[..5]).0.apply(at));
        }
    }

    #[test]
    fn points_on_a_line_have_no_breadth() {
        let line = (0..5).map(|k| DVec2::new(1.0, 2.0) * f64::from(k));
        assert!(breadth(line) < 1e-6);
        let square = [DVec2::ZERO, DVec2::X, DVec2::Y, DVec2::ONE];
        assert!((breadth(square.into_iter()) - 1.0).abs() < 1e-12);
    }
}
