//! Limits on changed faces: their height, and the side they face.

use glam::DVec3;

use crate::mesh::triangle_cross;

/// No move or split makes a face lower than this fraction of the target unless it was; at the end lower faces
/// lose an edge.
pub(super) const THIN: f64 = 0.1;

/// A face lower than this fraction of the target has no reliable side.
pub(super) const FLAT: f64 = 1e-4;

/// Faces may turn by this much when an edge collapses or flips: the cosine of 75 degrees.
const TURN: f64 = 0.26;

/// Which faces are thin, and which changes may remove them; lengths in m.
#[derive(Clone, Copy)]
pub(super) struct Thin {
    /// Lower faces are thin.
    pub(super) height: f64,
    /// Only shorter edges collapse, and in the last pass those at a vertex of least degree.
    pub(super) short: f64,
    /// No edge becomes longer, unless it was about as long.
    pub(super) longest: f64,
    /// Whether this is the last pass: it removes vertices of least degree, however long their edges are, and
    /// edges below a third of the target.
    pub(super) is_last: bool,
}

/// The least height of a triangle.
pub(super) fn height([a, b, c]: [DVec3; 3]) -> f64 {
    let longest = a.distance(b).max(b.distance(c)).max(c.distance(a));
    if longest > 0.0 { triangle_cross([a, b, c]).length() / longest } else { 0.0 }
}

/// Whether a face stays on its side; a face that was lower than `flat` must get the side of the faces around.
pub(super) fn keeps_side_around(old: [DVec3; 3], new: [DVec3; 3], flat: f64, around: DVec3) -> bool {
    if height(old) < flat {
        around.dot(triangle_cross(new)) >= 0.0
    } else {
        keeps_side(triangle_cross(old), triangle_cross(new))
    }
}

/// Whether a face stays on its side; one that had no area may face any side.
pub(super) fn keeps_side(old: DVec3, new: DVec3) -> bool {
    let lengths = (old.length_squared() * new.length_squared()).sqrt();
    old == DVec3::ZERO || old.dot(new) > TURN * lengths
}

/// The cosine of the smallest angle of a triangle: the largest of its cosines; 1 without area.
pub(super) fn largest_cosine(corners: [DVec3; 3]) -> f64 {
    let cosine = |k: usize| {
        let [at, p, q] = [0, 1, 2].map(|j| corners[(j + k) % 3]);
        let (u, v) = (p - at, q - at);
        u.dot(v) / (u.length_squared() * v.length_squared()).sqrt()
    };
    let largest = [0, 1, 2].map(cosine).into_iter().fold(-1.0, f64::max);
    if largest.is_nan() { 1.0 } else { largest }
}
