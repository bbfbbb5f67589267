//! Which matrices are rotations, and which poses are rigid.

use glam::{DAffine3, DMat3};

/// How far the columns of a matrix may be from an orthonormal frame and still count as one,
/// rounding apart.
const ROTATION_ROUNDING: f64 = 1e-9;

/// How far the axes of a pose may be from unit length and right angles: files store poses in `f32`,
/// and a chain of links multiplies a few of them.
const RIGID_TOLERANCE: f64 = 1e-5;

/// Whether a pose is finite and only rotates and translates.
pub(crate) fn is_rigid(pose: &DAffine3) -> bool {
    let axes = &pose.matrix3;
    pose.is_finite() && rotation_defect(axes) <= RIGID_TOLERANCE && axes.determinant() > 0.0
}

/// Whether a matrix neither scales nor mirrors.
pub(crate) fn is_rotation(matrix: &DMat3) -> bool {
    rotation_defect(matrix) <= ROTATION_ROUNDING && matrix.determinant() > 0.0
}

/// Largest entry of `M' M - I`: 0 for a rotation, infinite where an entry is not a number.
pub(crate) fn rotation_defect(matrix: &DMat3) -> f64 {
    let defect = matrix.transpose() * *matrix - DMat3::IDENTITY;
    let size = |x: f64| if x.is_nan() { f64::INFINITY } else { x.abs() };
    defect.to_cols_array().into_iter().map(size).fold(0.0, f64::max)
}
