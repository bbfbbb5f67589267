use glam::{DMat2, DVec2};

use crate::{id::FaceId, map::MapLevel};

/// How one face is stretched on its way from the skin to the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// `s1/s2`, the ratio of the singular values of the map's Jacobian: 1 at a conformal map, negative if the
    /// face is mirrored, infinite if it is squeezed to a line.
    pub angle: f64,
    /// `s1 s2`, the area on the map over the area on the skin: 1 at an equal-area map. Dividing the area of a
    /// pixel by it gives the skin that the pixel shows. Infinite if the face has no area on the skin.
    pub area: f64,
}

/// The stretch of `face`, constant over it.
///
/// # Panics
/// If the face does not exist.
#[must_use]
pub fn face_stretch(level: &MapLevel, face: FaceId) -> Stretch {
    const NO_SKIN: Stretch = Stretch { angle: f64::INFINITY, area: f64::INFINITY };
    let [a, b, c] = level.mesh.corners(face);
    let [p, q, r] = level.mesh.triangles[face].map(|v| level.uv[v]);
    // The skin's triangle laid into the plane: `ab` along the first axis.
    let (ab, ac) = (b - a, c - a);
    let base = ab.length();
    let height = ab.cross(ac).length() / base;
    let skin = DMat2::from_cols(DVec2::new(base, 0.0), DVec2::new(ab.dot(ac) / base, height));
    let determinant = base * height;
    if !(determinant > 0.0 && determinant.is_finite()) {
        return NO_SKIN;
    }
    let jacobian = DMat2::from_cols(q - p, r - p) * skin.inverse();
    let [e, f] = [jacobian.x_axis, jacobian.y_axis];
    // Singular values as the radii of the similar and the anti-similar part: no cancellation near 1.
    let similar = 0.5 * DVec2::new(e.x + f.y, e.y - f.x).length();
    let mirrored = 0.5 * DVec2::new(e.x - f.y, e.y + f.x).length();
    let (s1, s2) = (similar + mirrored, similar - mirrored);
    if !(s1.is_finite() && s2.is_finite()) {
        return NO_SKIN;
    }
    Stretch { angle: if s2 == 0.0 { f64::INFINITY } else { s1 / s2 }, area: s1 * s2 }
}
