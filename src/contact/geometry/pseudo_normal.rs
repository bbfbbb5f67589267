//! The outer side of a surface at any of its points: angle-weighted pseudo-normals.

use glam::DVec3;

use crate::{
    id::{FaceId, VertexId},
    mesh::{Feature, TriMesh, VertexCorners, angle},
};

/// A vector on the outer side of the surface at a feature of `face`, not of unit length.
///
/// Only with this one, the angle-weighted pseudo-normal, is the sign of the distance right
/// everywhere (Bærentzen and Aanæs, Signed distance computation using the angle weighted
/// pseudonormal, 2005).
pub(crate) fn pseudo_normal(around: &VertexCorners, mesh: &TriMesh, face: FaceId, feature: Feature) -> DVec3 {
    let unit = |f: FaceId| mesh.face_cross(f).normalize_or_zero();
    let ids = mesh.triangles[face];
    match feature {
        Feature::Inside => mesh.face_cross(face),
        Feature::Side(side) => {
            let [from, to] = [ids[side], ids[(side + 1) % 3]];
            let beside = around.faces(from).filter(|&f| mesh.triangles[f].contains(&to));
            beside.map(unit).sum()
        }
        Feature::Corner(corner) => {
            let v = ids[corner];
            around.faces(v).map(|f| unit(f) * angle_at(mesh, f, v)).sum()
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
