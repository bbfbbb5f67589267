//! The strain of a flat sheet that is laid on the skin.

use crate::id::FaceId;
use crate::map::{MapLevel, PatchMap};
use crate::mesh::{FlatTriangle, SingularValues};

/// The strains beyond which shares of the area are stated: up to 1 % paper and polyimide give way, up to 20 %
/// stretchable circuits.
pub const STRAINS: [f64; 4] = [0.01, 0.05, 0.1, 0.2];

/// The strain of each face of a sheet that is cut along the map and laid on the skin.
///
/// A map that stretches the skin by `s1` and `s2` makes a sheet whose strains on the skin are `1/s1 - 1` and
/// `1/s2 - 1`; that of a face is the one of larger magnitude: above 0 the sheet is stretched, below 0 compressed,
/// infinite where the map is flipped or has no area.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetStrain {
    /// Faces of the skin with their area on it, in m^2, and their strain. Faces without area are left out.
    pub faces: Vec<(FaceId, f64, f64)>,
}

impl SheetStrain {
    /// The strain of the finest level of a patch.
    pub(super) fn new(patch: &PatchMap, level: &MapLevel) -> Self {
        let mesh = &level.level.mesh;
        let count = mesh.triangles.len().saturating_sub(patch.filled);
        let of_face = |face: FaceId| {
            let flat = FlatTriangle::new(mesh.corners(face));
            let SingularValues { s1, s2 } = SingularValues::of(&flat.jacobian(level.uv_of(face)));
            let [least, most] = [1.0 / s1 - 1.0, if s2 > 0.0 { 1.0 / s2 - 1.0 } else { f64::INFINITY }];
            (face, flat.area(), if most.abs() >= least.abs() { most } else { least })
        };
        Self {
            faces: mesh.triangles.ids().take(count).map(of_face).filter(|(_, area, _)| *area > 0.0).collect(),
        }
    }

    /// Area of the skin, in m^2.
    pub fn area(&self) -> f64 {
        self.faces.iter().map(|(_, area, _)| area).sum()
    }

    /// Area of the faces whose strain is beyond `strain`, in m^2.
    pub fn area_beyond(&self, strain: f64) -> f64 {
        let is_beyond = |&&(.., found): &&(FaceId, f64, f64)| found.abs() > strain;
        // The sum of none is -0.
        self.faces.iter().filter(is_beyond).map(|(_, area, _)| area).sum::<f64>() + 0.0
    }
}
