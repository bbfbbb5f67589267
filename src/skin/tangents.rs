//! Tangents of taxels: the x axis of each taxel's frame, kept in the tangent plane of its normal.
//!
//! Shared by assembling, checking, reading and mapping.

use glam::DVec3;

use crate::{
    id::{IdVec, VertexId},
    mesh::TriMesh,
};

/// A direction less than 0.06 degrees (as a sine) from the normal has no direction in the tangent
/// plane: rounding alone would decide.
const LEAST_SINE: f64 = 1e-3;

/// The unit vector of `direction`, of any length, in the tangent plane of a unit normal; `None` for
/// a direction that is zero or along the normal.
pub(crate) fn in_tangent_plane(direction: DVec3, normal: DVec3) -> Option<DVec3> {
    let unit = direction.normalize_or_zero();
    let tangent = unit - unit.dot(normal) * normal;
    (tangent.length() > LEAST_SINE).then(|| tangent.normalize())
}

/// The directions, one per vertex and of any length, in the tangent planes of unit normals, as unit
/// vectors; and how many had to be replaced since they are zero or along the normal.
///
/// What replaces them is the mean direction of the neighbours; without one, a direction that
/// follows from the normal alone.
pub(crate) fn tangents_along(
    mesh: &TriMesh,
    normals: &IdVec<VertexId, DVec3>,
    directions: &IdVec<VertexId, DVec3>,
) -> (IdVec<VertexId, DVec3>, usize) {
    let found: IdVec<VertexId, Option<DVec3>> =
        directions.enumerate().map(|(v, &direction)| in_tangent_plane(direction, normals[v])).collect();
    let missing = found.iter().filter(|tangent| tangent.is_none()).count();
    let mut around = IdVec::<VertexId, DVec3>::filled(DVec3::ZERO, found.len());
    if missing > 0 {
        for corners in &mesh.triangles {
            let sum: DVec3 = corners.iter().filter_map(|&v| found[v]).sum();
            corners.iter().for_each(|&v| around[v] += sum);
        }
    }
    let tangent = |(v, found): (VertexId, &Option<DVec3>)| {
        let replaced = || in_tangent_plane(around[v], normals[v]);
        found.or_else(replaced).unwrap_or_else(|| normals[v].any_orthonormal_vector())
    };
    (found.enumerate().map(tangent).collect(), missing)
}
