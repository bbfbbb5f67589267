//! A point of a mesh.

use crate::id::FaceId;

/// A point of a mesh: a face and barycentric coordinates in it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// The face it lies on.
    pub face: FaceId,
    /// Weights of the face's corners, non-negative, sum 1.
    pub barycentric: [f64; 3],
}
