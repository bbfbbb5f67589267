//! The surface that is remeshed: its nearest points, its sharp edges and its rims.

use glam::DVec3;

use crate::bvh::{BvhError, Nearest, Start, TriangleTree};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Closest, TriMesh, closest_point};

/// Triangles, and the search for the one nearest to a point.
pub(super) struct Surface {
    mesh: TriMesh,
    normals: IdVec<FaceId, DVec3>,
    tree: TriangleTree,
}

/// The nearest point, and a packet of the tree at which the next search nearby may start.
pub(super) struct Projection {
    pub(super) point: DVec3,
    pub(super) near: Option<u32>,
}

impl Surface {
    pub(super) fn new(mesh: TriMesh) -> Result<Self, BvhError> {
        let tree = TriangleTree::new(
            mesh.positions.as_slice(),
            mesh.triangles.iter().map(|t| t.map(VertexId::raw)),
        )?;
        let normals = mesh.triangles.ids().map(|face| mesh.face_cross(face).normalize_or_zero()).collect();
        Ok(Self { mesh, normals, tree })
    }

    /// Line segments, as triangles of no area.
    pub(super) fn of_segments(
        positions: &IdVec<VertexId, DVec3>,
        segments: &[[VertexId; 2]],
    ) -> Option<Self> {
        let triangles = segments.iter().map(|&[a, b]| [a, b, b]).collect();
        Self::new(TriMesh { positions: positions.clone(), triangles }).ok()
    }

    /// The point nearest to `q` on the triangles that do not face away from `normal`: the other side of a thin
    /// wall does not count. Triangles without area face every direction.
    pub(super) fn nearest(&self, q: DVec3, normal: DVec3, near: Option<u32>) -> Option<Projection> {
        let (found, near) = self.search(q, normal, near);
        let (face, closest) = found?;
        let corners = self.mesh.corners(face);
        let point = corners.iter().zip(closest.barycentric).map(|(&p, weight)| p * weight).sum();
        Some(Projection { point, near })
    }

    /// The corners of the triangle with that point, and the weights of the point in it; of any triangle if all face away.
    pub(super) fn corners_at(&self, q: DVec3, normal: DVec3) -> Option<([VertexId; 3], [f64; 3])> {
        let any = || self.search(q, DVec3::ZERO, None).0;
        let (face, closest) = self.search(q, normal, None).0.or_else(any)?;
        Some((self.mesh.triangles[face], closest.barycentric))
    }

    fn search(&self, q: DVec3, normal: DVec3, near: Option<u32>) -> (Option<(FaceId, Closest)>, Option<u32>) {
        let start = near.map_or(Start::Root, Start::Packet);
        let search = NearestFace { surface: self, q, normal, best: None };
        let (search, packet) = self.tree.nearest(q, start, search);
        (search.best, packet)
    }
}

#[derive(Clone, Copy)]
struct NearestFace<'a> {
    surface: &'a Surface,
    q: DVec3,
    normal: DVec3,
    best: Option<(FaceId, Closest)>,
}

impl Nearest for NearestFace<'_> {
    #[inline(always)]
    fn squared(&self) -> f64 {
        self.best.as_ref().map_or(f64::INFINITY, |(_, best)| best.squared)
    }

    #[inline(always)]
    fn offer(&mut self, face: u32) -> bool {
        let face = FaceId::from(face);
        if self.surface.normals[face].dot(self.normal) < 0.0 {
            return false;
        }
        let mesh = &self.surface.mesh;
        let closest = closest_point(self.q, mesh.corners(face), mesh.triangles[face]);
        let is_nearer = self.best.as_ref().is_none_or(|(known, best)| {
            closest.squared < best.squared || (closest.squared == best.squared && face < *known)
        });
        if is_nearer {
            self.best = Some((face, closest));
        }
        is_nearer
    }

    #[inline(always)]
    fn prefetch(&self, _: u32) {}
}
