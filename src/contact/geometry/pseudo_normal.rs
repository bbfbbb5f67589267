//! The outer side of a surface at any of its points: angle-weighted pseudo-normals.

use glam::DVec3;

use crate::{
    contact::geometry::closest_point::Feature,
    id::{FaceId, IdVec, VertexId},
    mesh::{TriMesh, angle},
};

/// The faces around each vertex, for any set of triangles, manifold or not.
#[derive(Debug, Clone)]
pub(in crate::contact) struct Fans {
    /// Where the faces of each vertex start; one more entry than vertices.
    starts: Vec<u32>,
    faces: Vec<FaceId>,
}

impl Fans {
    /// Lists the faces of each vertex in the order of their ids.
    pub(in crate::contact) fn new(mesh: &TriMesh) -> Self {
        let mut starts = vec![0_u32; mesh.positions.len() + 1];
        for v in mesh.triangles.iter().flatten() {
            starts[v.index() + 1] += 1;
        }
        for i in 1..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut cursor = starts.clone();
        let mut faces = vec![FaceId::default(); 3 * mesh.triangles.len()];
        for (face, corners) in mesh.triangles.enumerate() {
            for v in corners {
                let at = &mut cursor[v.index()];
                faces[*at as usize] = face;
                *at += 1;
            }
        }
        Self { starts, faces }
    }

    /// The faces around `v`, smallest id first.
    pub(in crate::contact) fn around(&self, v: VertexId) -> &[FaceId] {
        &self.faces[self.starts[v.index()] as usize..self.starts[v.index() + 1] as usize]
    }

    /// A vector on the outer side of the surface at a feature of `face`, not of unit length.
    ///
    /// Only with this one, the angle-weighted pseudo-normal, is the sign of the distance right
    /// everywhere (Bærentzen and Aanæs, Signed distance computation using the angle weighted
    /// pseudonormal, 2005).
    pub(in crate::contact) fn pseudo_normal(&self, mesh: &TriMesh, face: FaceId, feature: Feature) -> DVec3 {
        let unit = |f: FaceId| mesh.face_cross(f).normalize_or_zero();
        let ids = mesh.triangles[face];
        match feature {
            Feature::Inside => mesh.face_cross(face),
            Feature::Side(side) => {
                let [from, to] = [ids[side], ids[(side + 1) % 3]];
                let beside = self.around(from).iter().filter(|&&f| mesh.triangles[f].contains(&to));
                beside.map(|&f| unit(f)).sum()
            }
            Feature::Corner(corner) => {
                let v = ids[corner];
                self.around(v).iter().map(|&f| unit(f) * angle_at(mesh, f, v)).sum()
            }
        }
    }
}

/// Angle of `face` at its corner `v`, in rad.
fn angle_at(mesh: &TriMesh, face: FaceId, v: VertexId) -> f64 {
    let ids = mesh.triangles[face];
    let k = ids.iter().position(|&w| w == v).unwrap_or(0);
    let at = |k: usize| mesh.positions[ids[k % 3]];
    angle(at(k), at(k + 1), at(k + 2))
}

/// The smallest face around each vertex that holds all of `corners`, at least one.
pub(in crate::contact) fn face_of_all(
    fans: &Fans,
    triangles: &IdVec<FaceId, [VertexId; 3]>,
    corners: &[VertexId],
) -> Option<FaceId> {
    let around = fans.around(*corners.first()?);
    around.iter().copied().find(|&f| corners.iter().all(|v| triangles[f].contains(v)))
}
