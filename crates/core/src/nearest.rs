//! The face of a mesh nearest to a point, among those that do not face away from a direction.

use glam::DVec3;

use crate::bvh::{BvhError, Nearest, Start, TriangleTree};
use crate::id::{FaceId, IdVec, VertexId};
use crate::mesh::{Closest, TriMesh, closest_point};

/// Triangles, and the search for the one nearest to a point.
pub(crate) struct NearestFaces {
    pub(crate) mesh: TriMesh,
    pub(crate) crosses: IdVec<FaceId, DVec3>,
    tree: TriangleTree,
}

impl NearestFaces {
    /// # Errors
    /// If there is no triangle, there are too many, or a position is too far from the origin.
    pub(crate) fn new(mesh: TriMesh) -> Result<Self, BvhError> {
        let tree = TriangleTree::new(
            mesh.positions.as_slice(),
            mesh.triangles.iter().map(|t| t.map(VertexId::raw)),
        )?;
        Ok(Self { crosses: mesh.face_crosses(), tree, mesh })
    }

    /// The face nearest to `q` of those that do not face away from `facing`, so that the other side of a thin wall does not
    /// count; of equally near ones the first. Faces without area face every direction, and all face a direction of length 0.
    ///
    /// The search begins at the packet of the tree `near`, which becomes that of the face found: a search nearby is faster.
    pub(crate) fn nearest(
        &self,
        q: DVec3,
        facing: DVec3,
        near: &mut Option<u32>,
    ) -> Option<(FaceId, Closest)> {
        let start = near.map_or(Start::Root, Start::Packet);
        let search = Search { faces: self, q, facing, best: None };
        let (search, packet) = self.tree.nearest(q, start, search);
        *near = packet;
        search.best
    }
}

#[derive(Clone, Copy)]
struct Search<'a> {
    faces: &'a NearestFaces,
    q: DVec3,
    facing: DVec3,
    best: Option<(FaceId, Closest)>,
}

impl Nearest for Search<'_> {
    #[inline(always)]
    fn squared(&self) -> f64 {
        self.best.as_ref().map_or(f64::INFINITY, |(_, best)| best.squared)
    }

    #[inline(always)]
    fn offer(&mut self, face: u32) -> bool {
        let face = FaceId::from(face);
        if self.faces.crosses[face].dot(self.facing) < 0.0 {
            return false;
        }
        let mesh = &self.faces.mesh;
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
