//! The skin that bodies press: the smooth surface through the taxels with their normals, not the facets between them.
//! On a convex skin facets are inside of it: taxels 7.7 mm apart on a cylinder of 40 mm radius would feel 7 % more than
//! the force on facets.
//!
//! Between taxels it is halfway from the triangle to the mean of the tangent planes at its corners, by barycentric
//! weights: Phong tessellation `(boubekeur2008)` with the factor 1/2, for which a quadratic surface is exact. Around a
//! taxel the skin bends away from its tangent plane by its mean curvature. The area of a triangle stays that of the plane: on
//! that cylinder it is 0.2 % less than that of the surface.

use glam::DVec3;

use crate::id::{FaceId, IdVec, VertexId};
use crate::signal::touch::path::Walker;
use crate::skin::Patch;

/// The point of the surface above a point of a triangle.
pub(super) fn rounded(corners: &[DVec3; 3], normals: &[DVec3; 3], weights: [f64; 3]) -> DVec3 {
    let flat = mix(corners, weights);
    let above = |k: usize| weights[k] * (flat - corners[k]).dot(normals[k]) * normals[k];
    flat - 0.5 * (above(0) + above(1) + above(2))
}

/// A mean by barycentric weights.
pub(super) fn mix(of: &[DVec3; 3], weights: [f64; 3]) -> DVec3 {
    of.iter().zip(weights).map(|(x, w)| w * *x).sum()
}

/// The point of the surface at a walker, and the normal there.
pub(super) fn below(walker: &Walker, patch: &Patch) -> Option<(DVec3, DVec3)> {
    let (weights, normals) = (walker.barycentric(&patch.mesh), normals(patch, walker.face));
    let point = rounded(&patch.mesh.corners(walker.face), &normals, weights);
    Some((point, mix(&normals, weights).try_normalize()?))
}

/// The normals at the corners of a face.
pub(super) fn normals(patch: &Patch, face: FaceId) -> [DVec3; 3] {
    patch.mesh.triangles[face].map(|v| patch.taxels.normals[v])
}

/// How far the surface is below the tangent plane of each taxel, in m: the mean over points with this variance along each
/// axis. It is half the sum of the curvatures, the divergence of the normals over the faces around the taxel, times the
/// variance. Where normals change within the reach of the points it is at most half their standard deviation.
pub(super) fn sagittas(patch: &Patch, variance: f64) -> IdVec<VertexId, f64> {
    let count = patch.mesh.positions.len();
    let (mut sums, mut areas) = (IdVec::filled(0.0, count), IdVec::filled(0.0, count));
    for face in patch.mesh.triangles.ids() {
        let (cross, corners) = (patch.mesh.face_cross(face), patch.mesh.corners(face));
        let normals = normals(patch, face);
        // The gradient of the weight of a corner is the cross product of normal and opposite edge over twice the area.
        let part = |k: usize| normals[k].dot(cross.cross(corners[(k + 2) % 3] - corners[(k + 1) % 3]));
        let divergence = (part(0) + part(1) + part(2)) / cross.length();
        if divergence.is_finite() {
            for v in patch.mesh.triangles[face] {
                sums[v] += divergence;
                areas[v] += cross.length();
            }
        }
    }
    let most = 0.5 * variance.sqrt();
    let sagitta = |(sum, area): (f64, f64)| {
        let sagitta = 0.5 * variance * sum / area;
        if sagitta.is_finite() { sagitta.clamp(-most, most) } else { 0.0 }
    };
    sums.iter().copied().zip(areas.iter().copied()).map(sagitta).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::id::FaceId;
    use crate::mesh::shapes;
    use crate::skin::{PatchId, Skin};

    /// Points between taxels are on the sphere or cylinder, and the skin bends away from tangent planes by its curvatures.
    #[test]
    fn spheres_and_cylinders_are_round() {
        let radius = 0.04;
        let tube = shapes::sheet(12, 12, |i, j| {
            let angle = 0.15 * f64::from(j);
            DVec3::new(0.006 * f64::from(i), radius * angle.sin(), radius * angle.cos())
        });
        type Shape = (fn(DVec3) -> DVec3, f64);
        let shapes: [(_, Shape); 2] =
            [(shapes::ball(8, radius), (|p| p, 2.0)), (tube, (|p| p.with_x(0.0), 1.0))];
        for (mesh, (from_axis, curvatures)) in shapes {
            let mut skin = Skin::from_mesh("skin", mesh);
            let patch = &mut skin.patches[PatchId::new(0)];
            patch.taxels.normals = patch.mesh.positions.map(|p| from_axis(*p).normalize());
            let middle = FaceId::new(patch.mesh.triangles.len() / 2);
            let corners = patch.mesh.corners(middle);
            let normals = normals(patch, middle);
            for weights in [[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [1.0 / 3.0; 3], [0.1, 0.2, 0.7]] {
                let away = |p: DVec3| (from_axis(p).length() - radius).abs();
                let (round, flat) =
                    (away(rounded(&corners, &normals, weights)), away(mix(&corners, weights)));
                assert!(round <= 0.03 * flat + 1e-12, "{weights:?}: {round} m, {flat} m");
            }
            let variance = 2e-6;
            for sagitta in &sagittas(patch, variance) {
                let needed = 0.5 * variance * curvatures / radius;
                assert!((sagitta / needed - 1.0).abs() < 0.02, "{sagitta} m, {needed} m");
            }
        }
    }
}
