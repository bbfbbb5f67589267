//! The outer side of a surface at any of its points: angle-weighted pseudo-normals.

use glam::DVec3;

use crate::{
    id::{FaceId, IdVec, VertexId},
    mesh::{Feature, VertexCorners, angle},
};

/// A vector on the outer side of a surface at a feature of `face`, not of unit length. `at` gives the
/// positions of the corners of the faces.
///
/// Only with this one, the angle-weighted pseudo-normal, is the sign of the distance right
/// everywhere (Bærentzen and Aanæs, Signed distance computation using the angle weighted
/// pseudonormal, 2005).
pub(crate) fn pseudo_normal(
    around: &VertexCorners,
    triangles: &IdVec<FaceId, [VertexId; 3]>,
    at: impl Fn(VertexId) -> DVec3 + Copy,
    face: FaceId,
    feature: Feature,
) -> DVec3 {
    let cross = |f: FaceId| {
        let [a, b, c] = triangles[f].map(at);
        (b - a).cross(c - a)
    };
    let unit = |f: FaceId| cross(f).normalize_or_zero();
    let ids = triangles[face];
    match feature {
        Feature::Inside => cross(face),
        Feature::Side(side) => {
            let [from, to] = [ids[side], ids[(side + 1) % 3]];
            let beside = around.faces(from).filter(|&f| triangles[f].contains(&to));
            beside.map(unit).sum()
        }
        Feature::Corner(corner) => {
            let v = ids[corner];
            around.faces(v).map(|f| unit(f) * angle_at(triangles[f], at, v)).sum()
        }
    }
}

/// Angle of a face at its corner `v`, in rad.
fn angle_at(ids: [VertexId; 3], at: impl Fn(VertexId) -> DVec3, v: VertexId) -> f64 {
    let k = ids.iter().position(|&w| w == v).unwrap_or(0);
    let at = |k: usize| at(ids[k % 3]);
    angle(at(k), at(k + 1), at(k + 2))
}
