//! The surface that is remeshed: its nearest points, its sharp edges and its rims.

use glam::DVec3;

use crate::bvh::BvhError;
use crate::id::{IdVec, VertexId};
use crate::mesh::TriMesh;
use crate::nearest::NearestFaces;

/// Triangles, and the search for the one nearest to a point.
pub(super) struct Surface(NearestFaces);

/// The nearest point, and a packet of the tree at which the next search nearby may start.
pub(super) struct Projection {
    pub(super) point: DVec3,
    pub(super) near: Option<u32>,
}

impl Surface {
    pub(super) fn new(mesh: TriMesh) -> Result<Self, BvhError> {
        NearestFaces::new(mesh).map(Self)
    }

    /// Line segments, as triangles of no area.
    pub(super) fn of_segments(
        positions: &IdVec<VertexId, DVec3>,
        segments: &[[VertexId; 2]],
    ) -> Option<Self> {
        let triangles = segments.iter().map(|&[a, b]| [a, b, b]).collect();
        Self::new(TriMesh { positions: positions.clone(), triangles }).ok()
    }

    /// The point nearest to `q` on the triangles that do not face away from `normal`.
    pub(super) fn nearest(&self, q: DVec3, normal: DVec3, mut near: Option<u32>) -> Option<Projection> {
        let (face, closest) = self.0.nearest(q, normal, &mut near)?;
        let corners = self.0.mesh.corners(face);
        let point = corners.iter().zip(closest.barycentric).map(|(&p, weight)| p * weight).sum();
        Some(Projection { point, near })
    }

    /// The corners of the triangle with that point, and the weights of the point in it; of any triangle if all face away.
    pub(super) fn corners_at(&self, q: DVec3, normal: DVec3) -> Option<([VertexId; 3], [f64; 3])> {
        let search = |facing| self.0.nearest(q, facing, &mut None);
        let (face, closest) = search(normal).or_else(|| search(DVec3::ZERO))?;
        Some((self.0.mesh.triangles[face], closest.barycentric))
    }
}
