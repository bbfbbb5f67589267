//! Which matrices are rotations.

use glam::DMat3;

/// How far the columns of a matrix may be from an orthonormal frame and still count as one,
/// rounding apart.
const ROTATION_ROUNDING: f64 = 1e-9;

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
