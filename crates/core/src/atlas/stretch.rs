//! The stretch of each face by a map: the angle and area channels of images and pictures.

use crate::id::FaceId;
use crate::map::MapLevel;
use crate::mesh::{FlatTriangle, SingularValues};

/// The stretch of one face from the skin to the map.
#[derive(Debug, Clone, Copy, PartialEq)]
#[doc(hidden)]
pub struct Stretch {
    /// `s1/s2`, the ratio of the singular values of the map's Jacobian: 1 at a conformal map,
    /// negative if the face is mirrored, infinite if it is squeezed to a line.
    #[doc(hidden)]
    pub angle: f64,
    /// `s1 s2`, the area on the map over the area on the skin: 1 at an equal-area map. Dividing the
    /// area of a pixel by it gives the skin that the pixel shows. Infinite if the face has no area
    /// on the skin.
    #[doc(hidden)]
    pub area: f64,
}

/// The stretch of `face`, constant over it.
/// Panics if the face does not exist.
#[doc(hidden)]
pub fn face_stretch(level: &MapLevel, face: FaceId) -> Stretch {
    const NO_SKIN: Stretch = Stretch { angle: f64::INFINITY, area: f64::INFINITY };
    let uv = level.uv_of(face);
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

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use crate::{mesh::shapes, pyramid::Level};

    #[test]
    fn stretch_of_known_maps() {
        let stretch = |map: &dyn Fn(DVec2) -> DVec2| {
            let mesh = shapes::square();
            let uv = mesh.positions.iter().map(|p| map(p.truncate())).collect();
            let areas = mesh.vertex_areas();
            face_stretch(&MapLevel::new(Level::finest(mesh, areas), None, uv, 0.1), FaceId::new(1))
        };
        let turned = stretch(&|p| 2.0 * DVec2::from_angle(0.7).rotate(p));
        assert!(
            (turned.angle - 1.0).abs() < 1e-12 && (turned.area - 4.0).abs() < 1e-12,
            "similarity: {turned:?}"
        );
        let sheared = stretch(&|p| DVec2::new(p.x + p.y, p.y));
        let golden = (3.0 + 5.0_f64.sqrt()) / 2.0;
        assert!(
            (sheared.angle - golden).abs() < 1e-12,
            "the unit shear's ratio is the golden section squared"
        );
        let mirrored = stretch(&|p| DVec2::new(-3.0 * p.x, p.y));
        assert!((mirrored.angle + 3.0).abs() < 1e-12 && (mirrored.area + 3.0).abs() < 1e-12, "{mirrored:?}");
        let squeezed = stretch(&|p| DVec2::new(p.x, 0.0));
        assert!(squeezed.angle == f64::INFINITY && squeezed.area == 0.0, "{squeezed:?}");
    }
}
