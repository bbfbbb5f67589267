//! The point of a triangle nearest to another point, in `f64`, and the outer side of the surface there.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{VertexCorners, angle, triangle_cross};

/// A triangle whose doubled area is less than this fraction of its longest side squared is measured by its
/// sides alone.
///
/// The direction of its normal is lost to rounding (2^-52 over this), while the sides err by at
/// most its height; at the square root of the rounding both errors are equal, a hundred-millionth
/// of the longest side.
const FLAT_HEIGHT: f64 = 1e-8;

/// Rounding of a barycentric weight, relative to the products it is made of: twice the three-term
/// sums of products.
const WEIGHT_ROUNDING: f64 = 16.0 * f64::EPSILON;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Feature {
    Inside,
    /// The side from this corner to the next.
    Side(usize),
    Corner(usize),
}

impl Feature {
    /// The corner, side or inside that a point of a triangle is on.
    pub(crate) fn at(barycentric: [f64; 3]) -> Self {
        match barycentric.map(|w| w <= 0.0) {
            [_, true, true] => Self::Corner(0),
            [true, _, true] => Self::Corner(1),
            [true, true, _] => Self::Corner(2),
            [_, _, true] => Self::Side(0),
            [true, _, _] => Self::Side(1),
            [_, true, _] => Self::Side(2),
            _ => Self::Inside,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Closest {
    /// Squared distance, in m^2.
    pub(crate) squared: f64,
    pub(crate) barycentric: [f64; 3],
    pub(crate) feature: Feature,
    /// Whether the triangle was measured by its sides alone, as one without area.
    pub(crate) is_flat: bool,
}

/// The point of the triangle nearest to `q`, in `f64`, for slivers and triangles without area too.
///
/// Above the inside of the triangle it is the distance to its plane, else the distance to a side, measured
/// from the smaller to the larger vertex id: two faces that share a side or corner find exactly the
/// same distance, so that face ids alone break the tie.
pub(crate) fn closest_point(q: DVec3, corners: [DVec3; 3], ids: [VertexId; 3]) -> Closest {
    let [a, b, c] = corners;
    let (ab, ac, aq) = (b - a, c - a, q - a);
    let normal = ab.cross(ac);
    let area = normal.length_squared();
    let longest = ab.length_squared().max(ac.length_squared()).max(b.distance_squared(c));
    if area <= (FLAT_HEIGHT * longest) * (FLAT_HEIGHT * longest) {
        return Closest { is_flat: true, ..closest_side(q, &corners, ids, [true; 3]) };
    }
    // Twice the areas opposite to each corner, signed, times that of the triangle.
    let weight_c = ab.cross(aq).dot(normal);
    let weight_b = aq.cross(ac).dot(normal);
    let weight_a = (c - b).cross(q - b).dot(normal);
    let margin = WEIGHT_ROUNDING * WEIGHT_ROUNDING * area * longest * aq.length_squared();
    let [sure_a, sure_b, sure_c] = [weight_a, weight_b, weight_c].map(|w| w > 0.0 && w * w > margin);
    if sure_a && sure_b && sure_c {
        let height = aq.dot(normal);
        let sum = weight_a + weight_b + weight_c;
        let barycentric = [weight_a / sum, weight_b / sum, weight_c / sum];
        return Closest {
            squared: height * height / area,
            barycentric,
            feature: Feature::Inside,
            is_flat: false,
        };
    }
    // Outside, the nearest side is one of those that have `q` on their far side.
    closest_side(q, &corners, ids, [!sure_c, !sure_a, !sure_b])
}

/// The nearest point of those sides `k` (corner `k` to `k + 1`) for which `tried[k]`.
fn closest_side(q: DVec3, corners: &[DVec3; 3], ids: [VertexId; 3], tried: [bool; 3]) -> Closest {
    let mut best = at_corner(0, f64::INFINITY);
    for side in 0..3 {
        if !tried[side] {
            continue;
        }
        let next = (side + 1) % 3;
        let (from, to) = if ids[side] < ids[next] { (side, next) } else { (next, side) };
        let along = corners[to] - corners[from];
        let offset = q - corners[from];
        let length = along.length_squared();
        let t = along.dot(offset) / length;
        let found = if t >= 1.0 {
            at_corner(to, q.distance_squared(corners[to]))
        } else if t > 0.0 {
            let mut barycentric = [0.0; 3];
            (barycentric[from], barycentric[to]) = (1.0 - t, t);
            let squared = (offset - along * t).length_squared();
            Closest { squared, barycentric, feature: Feature::Side(side), is_flat: false }
        } else {
            // Also where the side has no length and `t` is not a number.
            at_corner(from, offset.length_squared())
        };
        if found.squared < best.squared {
            best = found;
        }
    }
    best
}

fn at_corner(corner: usize, squared: f64) -> Closest {
    let mut barycentric = [0.0; 3];
    barycentric[corner] = 1.0;
    Closest { squared, barycentric, feature: Feature::Corner(corner), is_flat: false }
}

/// A vector on the outer side of a surface at a feature of `face`, not of unit length. `at` gives the
/// positions of the corners of the faces.
///
/// Only with the angle-weighted pseudo-normal is the sign of the distance right everywhere
/// `(baerentzen2005)`.
pub(crate) fn pseudo_normal(
    around: &VertexCorners,
    triangles: &IdVec<FaceId, [VertexId; 3]>,
    at: impl Fn(VertexId) -> DVec3 + Copy,
    face: FaceId,
    feature: Feature,
) -> DVec3 {
    let cross = |f: FaceId| triangle_cross(triangles[f].map(at));
    let unit = |f: FaceId| cross(f).normalize_or_zero();
    let ids = triangles[face];
    match feature {
        Feature::Inside => cross(face),
        Feature::Side(side) => {
            let [from, to] = [ids[side], ids[(side + 1) % 3]];
            let beside = around.faces(from).filter(|&f| triangles[f].contains(&to));
            beside.map(unit).sum()
        }
        Feature::Corner(corner) => {
            let v = ids[corner];
            around.faces(v).map(|f| unit(f) * angle_at(triangles[f], at, v)).sum()
        }
    }
}

/// Angle of a face at its corner `v`, in rad.
fn angle_at(ids: [VertexId; 3], at: impl Fn(VertexId) -> DVec3, v: VertexId) -> f64 {
    let k = ids.iter().position(|&w| w == v).unwrap_or(0);
    let at = |k: usize| at(ids[k % 3]);
    angle(at(k), at(k + 1), at(k + 2))
}
