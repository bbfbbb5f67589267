//! The weights of a face's corners at the pixels of a chart.

use glam::DVec2;

use crate::id::VertexId;
use crate::image::runs::{AT_ONCE, Plane, PlanesAtOnce};

/// Faces thinner than this on the image, in pixels, are drawn as their longest edge: pixel centres that they
/// show may lie `2^-17` pixels outside, where their steep planes would leave the range of the corners'
/// values.
const THIN: f64 = 1.0 / 128.0;

/// Weights of the corners of a face as linear functions of column and row, as in [`Plane`]; that of the first
/// corner is 1 minus the others.
#[derive(Debug, Clone, Copy)]
pub(super) struct FaceWeights {
    pub(super) corners: [VertexId; 3],
    second: [f64; 4],
    third: [f64; 4],
}

impl FaceWeights {
    /// A face with its corners in pixels, right and down.
    pub(super) fn new(corners: [VertexId; 3], [a, b, c]: [DVec2; 3]) -> Self {
        let area = (b - a).perp_dot(c - a);
        let edges = [(b - c).length(), (c - a).length(), (a - b).length()];
        let opposite = (1..3).fold(0, |best, k| if edges[k] > edges[best] { k } else { best });
        if area.abs() > THIN * edges[opposite] {
            let (second, third) = ((c - a).perp() / -area, (b - a).perp() / area);
            return Self { corners, second: linear(a, second), third: linear(a, third) };
        }
        let none = [0.0; 4];
        let along = |from: DVec2, to: DVec2| {
            let edge = to - from;
            let square = edge.length_squared();
            if square > 0.0 { linear(from, edge / square) } else { none }
        };
        let (second, third) = match opposite {
            0 => {
                let [base, right, down, _] = along(b, c);
                ([1.0 - base, -right, -down, 0.0], [base, right, down, 0.0])
            }
            1 => (none, along(a, c)),
            _ => (along(a, b), none),
        };
        Self { corners, second, third }
    }

    /// The weights at a pixel of the chart; up to rounding not negative where it shows the face.
    #[inline]
    pub(super) fn at(&self, column: u16, row: u16) -> [f64; 3] {
        let (x, y) = (f64::from(column), f64::from(row));
        let [second, third] =
            [self.second, self.third].map(|[base, right, down, _]| base + right * x + down * y);
        [1.0 - second - third, second, third]
    }

    /// The weights of the live corners at a pixel, with sum 1; `None` without any.
    pub(super) fn live_at(&self, column: u16, row: u16, live: [bool; 3]) -> Option<[f64; 3]> {
        let weights = self.at(column, row);
        if live == [true; 3] {
            return Some(weights);
        }
        let mask = live.map(|is_live| if is_live { 1.0 } else { 0.0 });
        let mut weights = [0, 1, 2].map(|k| mask[k] * weights[k].max(0.0));
        let mut sum: f64 = weights.iter().sum();
        if sum <= 0.0 {
            // The pixel lies on a dead corner.
            (weights, sum) = (mask, mask.iter().sum());
        }
        (sum > 0.0).then(|| weights.map(|w| w / sum))
    }

    /// The plane through the values of the corners; NaN where one has none.
    #[inline]
    pub(super) fn plane(&self, x: &[f64]) -> Plane {
        let [a, b, c] = self.corners.map(|v| x[v.index()]);
        let (p, q, first) = (b - a, c - a, [a, 0.0, 0.0, 0.0]);
        let mut plane = [0.0; 4];
        for (k, number) in plane.iter_mut().enumerate() {
            *number = first[k] + (p * self.second[k] + q * self.third[k]);
        }
        Plane(plane)
    }

    /// [`Self::plane`] in sixteen frames, of values times `scale`.
    pub(super) fn planes_at_once(&self, x: &[[f64; AT_ONCE]], scale: &[f64], planes: &mut PlanesAtOnce) {
        let [(a, i), (b, j), (c, k)] = self.corners.map(|v| (&x[v.index()], scale[v.index()]));
        let [base, right, down] = planes;
        for frame in 0..AT_ONCE {
            let first = a[frame] * i;
            let (p, q) = (b[frame] * j - first, c[frame] * k - first);
            base[frame] = first + (p * self.second[0] + q * self.third[0]);
            right[frame] = 0.0 + (p * self.second[1] + q * self.third[1]);
            down[frame] = 0.0 + (p * self.second[2] + q * self.third[2]);
        }
    }

    /// Number of corners that are live.
    pub(super) fn live_corners(&self, is_live: impl Fn(VertexId) -> bool) -> usize {
        self.corners.iter().filter(|&&v| is_live(v)).count()
    }
}

/// `gradient . (p - from)` at the centre of the pixel `(column, row)`, as base and steps.
fn linear(from: DVec2, gradient: DVec2) -> [f64; 4] {
    [gradient.dot(DVec2::splat(0.5) - from), gradient.x, gradient.y, 0.0]
}
