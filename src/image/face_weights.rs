//! The weights of a face's corners at the pixels of a chart.

use glam::DVec2;

use crate::{
    atlas::Chart,
    id::{IdVec, VertexId},
    image::runs::Plane,
    map::MapLevel,
};

/// Faces that are thinner than this on the image, in pixels, are drawn as their longest edge: the
/// centres that they show may lie `2^-17` pixels outside, where their steep planes would leave the
/// range of the corners' values.
const THIN: f64 = 1.0 / 128.0;

/// Weights of the corners of a face as linear functions of column and row; that of the first corner
/// is what the others leave of 1.
#[derive(Debug, Clone, Copy)]
pub(super) struct FaceWeights {
    pub(super) corners: [VertexId; 3],
    /// At the chart's first pixel, and the steps right and down.
    second: [f64; 3],
    third: [f64; 3],
}

impl FaceWeights {
    /// The faces of a level that `chart` shows.
    pub(super) fn of_chart(chart: &Chart, level: &MapLevel) -> Vec<Self> {
        let at: IdVec<VertexId, DVec2> = level.uv.map(|&uv| chart.pixel_position(uv));
        level.level.mesh.triangles.iter().map(|&t| Self::new(t, t.map(|v| at[v]))).collect()
    }

    /// A face with its corners in pixels, right and down.
    fn new(corners: [VertexId; 3], [a, b, c]: [DVec2; 3]) -> Self {
        let area = (b - a).perp_dot(c - a);
        let edges = [(b - c).length(), (c - a).length(), (a - b).length()];
        let opposite = (1..3).fold(0, |best, k| if edges[k] > edges[best] { k } else { best });
        if area.abs() > THIN * edges[opposite] {
            let (second, third) = ((c - a).perp() / -area, (b - a).perp() / area);
            return Self { corners, second: linear(a, second), third: linear(a, third) };
        }
        let none = [0.0; 3];
        let along = |from: DVec2, to: DVec2| {
            let edge = to - from;
            let square = edge.length_squared();
            if square > 0.0 { linear(from, edge / square) } else { none }
        };
        let (second, third) = match opposite {
            0 => {
                let [base, right, down] = along(b, c);
                ([1.0 - base, -right, -down], [base, right, down])
            }
            1 => (none, along(a, c)),
            _ => (along(a, b), none),
        };
        Self { corners, second, third }
    }

    /// The weights at a pixel of the chart; but for rounding not negative where it shows the face.
    #[inline]
    pub(super) fn at(&self, column: u16, row: u16) -> [f64; 3] {
        let (x, y) = (f64::from(column), f64::from(row));
        let [second, third] =
            [self.second, self.third].map(|[base, right, down]| base + right * x + down * y);
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

    /// The plane through the values of the corners; constant where one corner has a value, NaN
    /// where two or none has.
    #[inline]
    pub(super) fn plane(&self, x: &[f64]) -> Plane {
        let [a, b, c] = self.corners.map(|v| x[v.index()]);
        let (p, q) = (b - a, c - a);
        let mix = |k: usize| p * self.second[k] + q * self.third[k];
        let plane = Plane { base: a + mix(0), right: mix(1), down: mix(2) };
        if plane.base.is_nan() { one_live([a, b, c]) } else { plane }
    }
}

/// The one value that is not NaN, else NaN.
#[cold]
fn one_live(values: [f64; 3]) -> Plane {
    let mut live = values.into_iter().filter(|x| !x.is_nan());
    let value = live.next().unwrap_or(f64::NAN);
    Plane::constant(if live.next().is_some() { f64::NAN } else { value })
}

/// `gradient . (p - from)` at the centre of the pixel `(column, row)`, as base and steps.
fn linear(from: DVec2, gradient: DVec2) -> [f64; 3] {
    [gradient.dot(DVec2::splat(0.5) - from), gradient.x, gradient.y]
}
