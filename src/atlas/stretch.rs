//! How much a map stretches each face: the angle and area channels of images and pictures.

use crate::{
    id::FaceId,
    map::MapLevel,
    mesh::{FlatTriangle, SingularValues},
};

/// How one face is stretched on its way from the skin to the map.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stretch {
    /// `s1/s2`, the ratio of the singular values of the map's Jacobian: 1 at a conformal map,
    /// negative if the face is mirrored, infinite if it is squeezed to a line.
    pub angle: f64,
    /// `s1 s2`, the area on the map over the area on the skin: 1 at an equal-area map. Dividing the
    /// area of a pixel by it gives the skin that the pixel shows. Infinite if the face has no area
    /// on the skin.
    pub area: f64,
}

/// The stretch of `face`, constant over it.
///
/// # Panics
/// If the face does not exist.
#[must_use]
pub fn face_stretch(level: &MapLevel, face: FaceId) -> Stretch {
    const NO_SKIN: Stretch = Stretch { angle: f64::INFINITY, area: f64::INFINITY };
    let uv = level.level.mesh.triangles[face].map(|v| level.uv[v]);
    let flat = FlatTriangle::new(level.level.mesh.corners(face));
    if !(flat.area() > 0.0 && flat.area().is_finite()) {
        return NO_SKIN;
    }
    let SingularValues { s1, s2, .. } = SingularValues::of(&flat.jacobian(uv));
    if !(s1.is_finite() && s2.is_finite()) {
        return NO_SKIN;
    }
    Stretch { angle: if s2 == 0.0 { f64::INFINITY } else { s1 / s2 }, area: s1 * s2 }
}
