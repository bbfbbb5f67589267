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
    const SELECTS: bool = true;

    #[inline(always)]
    fn squared(&self) -> f64 {
        self.best.as_ref().map_or(f64::INFINITY, |(_, best)| best.squared)
    }

    #[inline(always)]
    fn takes(&self, face: u32) -> bool {
        self.faces.crosses[FaceId::from(face)].dot(self.facing) >= 0.0
    }

    #[inline(always)]
    fn offer(&mut self, face: u32) -> bool {
        let face = FaceId::from(face);
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Of all faces that do not face away, the nearest, as one loop over them finds it.
    fn by_one_loop(faces: &NearestFaces, q: DVec3, facing: DVec3) -> Option<f64> {
        let mesh = &faces.mesh;
        let squared = mesh.triangles.enumerate().filter(|&(face, _)| faces.crosses[face].dot(facing) >= 0.0);
        squared.map(|(face, t)| closest_point(q, mesh.corners(face), *t).squared).min_by(f64::total_cmp)
    }

    /// Two walls of triangles whose sides face each other's back, a millimetre apart, and points on both sides of them.
    #[test]
    fn the_other_side_of_a_wall_hides_nothing() {
        let (mut positions, mut triangles) = (Vec::new(), Vec::new());
        for k in 0..40_u32 {
            for (z, turned) in [(0.0, false), (-0.001, true)] {
                let [x, y] = [f64::from(k % 8), f64::from(k / 8)].map(|x| 0.01 * x);
                let first = 6 * k + if turned { 3 } else { 0 };
                positions.extend([[x, y, z], [x + 0.01, y, z], [x, y + 0.01, z]].map(DVec3::from));
                triangles.push(if turned {
                    [first, first + 2, first + 1]
                } else {
                    [first, first + 1, first + 2]
                });
            }
        }
        let faces = NearestFaces::new(TriMesh::from_arrays(positions, &triangles)).unwrap();
        for facing in [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::ZERO, DVec3::new(0.3, 0.1, -0.02)] {
            for k in 0..200 {
                let k = f64::from(k);
                let q = DVec3::new((0.0037 * k) % 0.08, (0.0011 * k) % 0.05, 0.0007 * (k % 9.0) - 0.0035);
                for mut near in [None, Some(0), Some(5)] {
                    let found = faces.nearest(q, facing, &mut near).map(|(_, closest)| closest.squared);
                    assert_eq!(found, by_one_loop(&faces, q, facing), "{q} {facing}");
                }
                let far = q + DVec3::splat(1e6);
                let found = faces.nearest(far, facing, &mut None).map(|(_, closest)| closest.squared);
                assert_eq!(found, by_one_loop(&faces, far, facing), "{far} {facing}");
            }
        }
    }
}
