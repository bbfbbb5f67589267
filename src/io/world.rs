use std::borrow::Cow;

use glam::{DAffine3, DMat3};

use crate::skin::{Patch, Skin, world_pose};

/// A patch as it lies in the world, for formats that know no frames.
///
/// Positions with their covariances and normals follow the pose of the patch's link. A pose that scales also scales areas and densities, and
/// one that mirrors turns the triangles round, so that they still run counter-clockwise seen from outside.
pub(crate) fn in_world<'a>(skin: &Skin, patch: &'a Patch) -> Cow<'a, Patch> {
    let pose = world_pose(&skin.links, patch.link);
    if pose == DAffine3::IDENTITY {
        return Cow::Borrowed(patch);
    }
    let mut posed = patch.clone();
    // Normals, and areas along them, go by the cofactors of the matrix.
    let matrix = pose.matrix3;
    let cofactors =
        DMat3::from_cols(matrix.y_axis.cross(matrix.z_axis), matrix.z_axis.cross(matrix.x_axis), {
            matrix.x_axis.cross(matrix.y_axis)
        });
    let mirrored = matrix.determinant() < 0.0;
    let rigid = is_rotation(&matrix);
    posed.mesh.positions = patch.mesh.positions.map(|&x| pose.transform_point3(x));
    for (v, n) in patch.normals.enumerate() {
        if rigid {
            posed.normals[v] = matrix * *n;
            continue;
        }
        let across = cofactors * *n;
        let stretch = across.length();
        posed.normals[v] = across.normalize_or_zero() * if mirrored { -1.0 } else { 1.0 };
        posed.areas[v] *= stretch;
        if let Some(densities) = &mut posed.densities {
            densities[v] /= stretch;
        }
    }
    if let Some(covariances) = &mut posed.covariances {
        for c in covariances.iter_mut() {
            let [xx, xy, xz, yy, yz, zz] = *c;
            let turned =
                matrix * DMat3::from_cols_array(&[xx, xy, xz, xy, yy, yz, xz, yz, zz]) * matrix.transpose();
            let [x, y, z] = [turned.x_axis, turned.y_axis, turned.z_axis];
            *c = [x.x, y.x, z.x, y.y, z.y, z.z];
        }
    }
    if mirrored {
        posed.mesh.triangles = patch.mesh.triangles.map(|&[a, b, c]| [a, c, b]);
    }
    Cow::Owned(posed)
}

/// How far the columns of a matrix may be from an orthonormal frame and still count as one, rounding apart.
const ROTATION_ROUNDING: f64 = 1e-9;

/// Whether a matrix neither scales nor mirrors.
pub(crate) fn is_rotation(matrix: &DMat3) -> bool {
    rotation_defect(matrix) <= ROTATION_ROUNDING && matrix.determinant() > 0.0
}

/// Largest entry of `M' M - I`: 0 for a rotation.
pub(crate) fn rotation_defect(matrix: &DMat3) -> f64 {
    let defect = matrix.transpose() * *matrix - DMat3::IDENTITY;
    defect.to_cols_array().into_iter().fold(0.0, |worst, x| if x.abs() <= worst { worst } else { x.abs() })
}
