//! Transforms of nodes: the rigid pose of a link, and what is left for the positions.

use glam::{DAffine3, DMat3, DQuat, DVec3};

use crate::io::{
    IoError,
    gltf::{document::Document, guard::Transform},
};

/// A matrix whose columns are orthonormal to this much is taken for a rotation: f32 rounding leaves
/// about 1e-7, and a quaternion holds no more.
pub(super) const RIGID: f64 = 1e-6;
/// How far a quaternion may be from unit length; the Khronos validator allows as much.
const UNIT_ROTATION: f64 = 5e-5;
/// Largest cosine between the axes of a node's matrix: more is shear, which glTF forbids.
const SHEAR: f64 = 1e-4;

/// A node's own transform: `translation * rotation * stretch`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Local {
    translation: DVec3,
    rotation: DMat3,
    /// `None`: none.
    stretch: Option<DMat3>,
    /// Whether nothing is squeezed to zero.
    invertible: bool,
}

impl Local {
    /// Whether a transform changes nothing.
    pub(super) fn is_identity(node: &Transform) -> bool {
        let no_matrix = node.matrix.as_deref().is_none_or(|m| *m == IDENTITY);
        no_matrix
            && node.translation.is_none_or(|t| t == [0.0; 3])
            && node.rotation.is_none_or(|r| r == [0.0, 0.0, 0.0, 1.0])
            && node.scale.is_none_or(|s| s == [1.0; 3])
    }

    /// Reads and checks the transform of node `i`.
    pub(super) fn of(document: &Document, i: usize) -> Result<Self, IoError> {
        let node = &document.transforms[i];
        let refuse = |found: String, needed: &str| Err(document.invalid(format!("node {i}"), found, needed));
        if let Some(m) = &node.matrix {
            if node.translation.is_some() || node.rotation.is_some() || node.scale.is_some() {
                return refuse("a matrix next to translation, rotation or scale".into(), "one or the other");
            }
            let linear = DMat3::from_cols_array(&[m[0], m[1], m[2], m[4], m[5], m[6], m[8], m[9], m[10]]);
            let [x, y, z] = [linear.x_axis, linear.y_axis, linear.z_axis].map(DVec3::normalize_or_zero);
            let skew = [x.dot(y), y.dot(z), z.dot(x)].into_iter().fold(0.0, |a: f64, b| a.max(b.abs()));
            if [m[3], m[7], m[11], m[15]] != [0.0, 0.0, 0.0, 1.0] || skew > SHEAR {
                return refuse(format!("the matrix {m:?}"), "one made of translation, rotation and scale");
            }
            let (rotation, stretch, invertible) = match split(linear) {
                Some((rotation, stretch)) => (rotation, stretch, true),
                None => (DMat3::IDENTITY, Some(linear), false),
            };
            return Ok(Self { translation: DVec3::new(m[12], m[13], m[14]), rotation, stretch, invertible });
        }
        let quaternion = DQuat::from_array(node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]));
        if (quaternion.length() - 1.0).abs() > UNIT_ROTATION {
            return refuse(format!("a rotation of length {}", quaternion.length()), "a unit quaternion");
        }
        let scale = DVec3::from_array(node.scale.unwrap_or([1.0; 3]));
        Ok(Self {
            translation: DVec3::from_array(node.translation.unwrap_or_default()),
            rotation: DMat3::from_quat(quaternion.normalize()),
            stretch: (scale != DVec3::ONE).then(|| DMat3::from_diagonal(scale)),
            invertible: scale.cmpne(DVec3::ZERO).all(),
        })
    }

    /// Rigid pose and remaining stretch below a link that is stretched itself; `None` if something
    /// becomes flat.
    pub(super) fn below(self, above: Option<DMat3>) -> Option<(DAffine3, Option<DMat3>)> {
        if !self.invertible {
            return None;
        }
        let Some(above) = above else {
            return Some((DAffine3::from_mat3_translation(self.rotation, self.translation), self.stretch));
        };
        let (rotation, stretch) = split(above * self.rotation * self.stretch.unwrap_or(DMat3::IDENTITY))?;
        Some((DAffine3::from_mat3_translation(rotation, above * self.translation), stretch))
    }
}

/// The matrix that does nothing, by columns.
const IDENTITY: [f64; 16] = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];

/// Splits a linear map into a rotation and what remains to be done before it (`None`: nothing). A
/// mirror stays in the remainder. By Gram-Schmidt, so the axes of a scaled frame keep their
/// directions.
fn split(linear: DMat3) -> Option<(DMat3, Option<DMat3>)> {
    let x = linear.x_axis.try_normalize()?;
    let y = linear.y_axis.reject_from_normalized(x).try_normalize()?;
    let rotation = DMat3::from_cols(x, y, x.cross(y));
    let stretch = rotation.transpose() * linear;
    let determinant = stretch.determinant();
    if determinant == 0.0 || !determinant.is_finite() {
        return None;
    }
    Some((rotation, (!stretch.abs_diff_eq(DMat3::IDENTITY, RIGID)).then_some(stretch)))
}
